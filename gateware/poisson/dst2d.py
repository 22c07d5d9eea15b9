# amaranth: UnusedElaboratable=no
"""Poisson solver with two-dimensional sine transforms (DST-I) around a division by the eigenvalues."""

from typing import ClassVar

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.poisson.eigenvalue_division import EigenvalueDivider
from fastac.gateware.poisson.in_place_transposer import InPlaceTransposer
from fastac.gateware.poisson.source import PoissonSourceStream
from fastac.gateware.poisson.stages import (
    check_stages,
    connect_stages,
    frame_interval,
    sine_transform,
    transform_delay,
    transform_slices,
)
from fastac.gateware.poisson.transposer import Transposer
from fastac.gateware.stream.queues import SkidBuffer
from fastac.models.integer.dst2d import EigenvalueDivision, reciprocal_distance
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource


class PoissonSolver(wiring.Component):
    """Solve for the N × N inner pixels of a frame of slopes, N = width − 2.

    Source, DST-I of the rows, transposition, DST-I of the columns, division by the eigenvalues, inverse DST-I
    of the columns, transposition, inverse DST-I of the rows. Every stage sustains `lanes` values per clock,
    and consecutive frames overlap. With a `fold` above 1 there is one lane, whose slopes are taken at most
    every `fold` clocks; transforms share their multipliers over so many clocks (FoldedDst1), and frames are
    transposed in one page (InPlaceTransposer).

    Members
    -------
    i : stream of `lanes` slopes (p, q), 2 × signed(source.gradient_width), height × width in raster order
    o : stream of `lanes` solutions, signed(row_inverse.output_width): N rows of `beats` = ceil(N/lanes) beats
    offset : write port, see PoissonSourceStream. Only with `loadable`.

    The lanes beyond N in a row's last beat are undefined. Without back-pressure, `frame_latency` clocks pass
    from a frame's first slopes, with a beat every `fold` clocks, to its last solutions, and `latency` =
    frame_latency − fold · (N · beats − 1) to its first ones; `stages` has each stage's share of
    `frame_latency`, in order. Initiation interval: `interval` = fold · max(height · width / lanes, N · beats)
    clocks per frame. No combinational path of `ready` passes a
    transform, whose `i.ready` comes from registers.
    """

    last_row_first = False
    engines: ClassVar = {SineTransform: sine_transform, EigenvalueDivision: EigenvalueDivider}

    def __init__(
        self,
        source: PoissonSource,
        row_forward: SineTransform,
        column_forward: SineTransform,
        division: EigenvalueDivision,
        column_inverse: SineTransform,
        row_inverse: SineTransform,
        *,
        height: int,
        width: int,
        lanes: int,
        fold: int = 1,
        loadable: bool = False,
        dsp: DspSlice = DSP48E2,
    ):
        stages = {
            "row_forward": row_forward,
            "column_forward": column_forward,
            "division": division,
            "column_inverse": column_inverse,
            "row_inverse": row_inverse,
        }
        check_stages(stages, source.width, height, width)

        self.source = PoissonSourceStream(source, height=height, width=width, lanes=lanes, loadable=loadable)
        self.row_forward = sine_transform(row_forward, lanes=lanes, fold=fold, dsp=dsp)
        self.to_columns = self._transposer(width - 2, row_forward.output_width, lanes, fold)
        self.column_forward = sine_transform(column_forward, lanes=lanes, fold=fold, dsp=dsp)
        self.division = EigenvalueDivider(division, lanes=lanes, fold=fold, dsp=dsp)
        self.column_inverse = sine_transform(column_inverse, lanes=lanes, fold=fold, dsp=dsp)
        self.to_rows = self._transposer(width - 2, column_inverse.output_width, lanes, fold)
        self.row_inverse = sine_transform(row_inverse, lanes=lanes, fold=fold, dsp=dsp)
        members = {"i": In(self.source.i.signature.flip()), "o": Out(self.row_inverse.o.signature)}
        if loadable:
            members["offset"] = In(self.source.table.signature)
        super().__init__(members)
        self.size, self.beats, self.fold = width - 2, -(-(width - 2) // lanes), fold
        self.interval = frame_interval(height, width, lanes, fold)

    @staticmethod
    def _transposer(size: int, width: int, lanes: int, fold: int) -> Transposer | InPlaceTransposer:
        if fold > 1:
            return InPlaceTransposer(size, width, fold=fold)
        return Transposer(size, width, lanes=lanes)

    @staticmethod
    def stages_of(
        width: int, lanes: int, divergence: str, distance: int | None = None, *, fold: int = 1
    ) -> dict[str, int]:
        """`stages` for images of `width` pixels.

        distance : of the largest from the lowest shift of the division; None: that of `reciprocals`
        """
        size = width - 2
        if distance is None:
            distance = reciprocal_distance(size)
        beats = -(-size // lanes)
        transposition = (InPlaceTransposer if fold > 1 else Transposer).latency + (size * beats - 1) * fold
        source = PoissonSourceStream.delay_of(
            size - 1, beats - 1, width=width, lanes=lanes, divergence=divergence, fold=fold
        )
        transform = transform_delay(size, lanes, fold)
        return {
            "source": source + SkidBuffer.latency,
            "row_forward": transform,
            "to_columns": transposition,
            "column_forward": transform + SkidBuffer.latency,
            "division": EigenvalueDivider.latency_of(distance) + SkidBuffer.latency,
            "column_inverse": transform,
            "to_rows": transposition,
            "row_inverse": transform,
        }

    @staticmethod
    def multipliers_of(
        size: int,
        lanes: int,
        *,
        fold: int = 1,
        source_width: int,
        data_bits: int,
        coefficient_width: int,
        dsp: DspSlice,
    ) -> int:
        """DSP slices at most: those of words of `data_bits`."""
        widths = (source_width, data_bits, data_bits, data_bits)
        transforms = transform_slices(
            size, lanes, widths, fold=fold, coefficient_width=coefficient_width, dsp=dsp
        )
        return transforms + EigenvalueDivider.multipliers_of(lanes, input_width=data_bits, dsp=dsp)

    @property
    def stages(self) -> dict[str, int]:
        """Clocks from last beat to last beat of each stage; the first entry counts from the first slopes."""
        source = self.source
        divergence, distance = source.source.divergence, self.division.distance
        return self.stages_of(source.width, source.lanes, divergence, distance, fold=self.fold)

    @property
    def frame_latency(self) -> int:
        return sum(self.stages.values())

    @property
    def latency(self) -> int:
        return self.frame_latency - (self.size * self.beats - 1) * self.fold

    @property
    def multipliers(self) -> int:
        parts = (
            *(self.row_forward, self.column_forward, self.division),
            *(self.column_inverse, self.row_inverse),
        )
        return sum(part.multipliers for part in parts)

    def elaborate(self, platform):
        m = Module()
        # Skid buffers where neither neighbour cuts the path of `ready` (transforms and transposers do).
        connect_stages(m, self, ("source", "column_forward", "division"))
        return m
