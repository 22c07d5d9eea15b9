# amaranth: UnusedElaboratable=no
"""Poisson solver without transposers: sine transforms of the rows around the Thomas algorithm."""

from typing import ClassVar

from amaranth import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.poisson.frame_reversal import FrameReversal
from fastac.gateware.poisson.recurrence import RowRecurrence
from fastac.gateware.poisson.source import PoissonSourceStream
from fastac.gateware.poisson.stages import (
    check_stages,
    connect_stages,
    frame_interval,
    sine_transform,
    transform_delay,
    transform_slices,
)
from fastac.gateware.stream.queues import SkidBuffer
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.tridiagonal import Elimination, Substitution


class TridiagonalPoissonSolver(wiring.Component):
    """Solve for the N × N inner pixels of a frame of slopes, N = width − 2, and output the last row first.

    Source, DST-I of the rows, forward elimination down the rows, reversal of the row order, back substitution
    up the rows, inverse DST-I of the rows (models/integer/tridiagonal.py). Every stage sustains `lanes`
    values per clock, and consecutive frames overlap. With a `fold` above 1 there is one lane, whose slopes
    are taken at most every `fold` clocks; transforms share their multipliers over so many clocks
    (FoldedDst1), and the reversal gives a value every `fold` clocks.

    Members
    -------
    i : stream of `lanes` slopes (p, q), 2 × signed(source.gradient_width), height × width in raster order
    o : stream of `lanes` solutions, signed(row_inverse.output_width): N rows of `beats` = ceil(N/lanes)
        beats, last row first, each row in column order
    row : range(N), the inner row of the beat at `o`
    offset : write port, see PoissonSourceStream. Only with `loadable`.

    The lanes beyond N in a row's last beat are undefined. Without back-pressure, `frame_latency` clocks pass
    from a frame's first slopes, with a beat every `fold` clocks, to its last solutions, and `latency` =
    frame_latency − fold · (N · beats − 1) to its first ones; `stages` has each stage's share of
    `frame_latency`, in order. Initiation interval: `interval` = fold · max(height · width / lanes, N · beats)
    clocks per frame. No combinational path of `ready` passes a
    transform, whose `i.ready` comes from registers.
    """

    last_row_first = True
    engines: ClassVar = {
        SineTransform: sine_transform,
        Elimination: RowRecurrence,
        Substitution: RowRecurrence,
    }

    def __init__(
        self,
        source: PoissonSource,
        row_forward: SineTransform,
        elimination: Elimination,
        substitution: Substitution,
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
            "elimination": elimination,
            "substitution": substitution,
            "row_inverse": row_inverse,
        }
        check_stages(stages, source.width, height, width)

        self.source = PoissonSourceStream(source, height=height, width=width, lanes=lanes, loadable=loadable)
        self.row_forward = sine_transform(row_forward, lanes=lanes, fold=fold, dsp=dsp)
        self.elimination = RowRecurrence(elimination, lanes=lanes, fold=fold, dsp=dsp)
        self.reversal = FrameReversal(width - 2, elimination.output_width, lanes=lanes, fold=fold)
        self.substitution = RowRecurrence(substitution, lanes=lanes, fold=fold, dsp=dsp)
        self.row_inverse = sine_transform(row_inverse, lanes=lanes, fold=fold, dsp=dsp)
        self.size, self.beats, self.fold = width - 2, self.elimination.beats, fold
        self.interval = frame_interval(height, width, lanes, fold)
        members = {
            "i": In(self.source.i.signature.flip()),
            "o": Out(self.row_inverse.o.signature),
            "row": Out(range(self.size)),
        }
        if loadable:
            members["offset"] = In(self.source.table.signature)
        super().__init__(members)

    @staticmethod
    def stages_of(width: int, lanes: int, divergence: str, *, fold: int = 1) -> dict[str, int]:
        """`stages` for images of `width` pixels."""
        size = width - 2
        beats = -(-size // lanes)
        source = PoissonSourceStream.delay_of(
            size - 1, beats - 1, width=width, lanes=lanes, divergence=divergence, fold=fold
        )
        transform = transform_delay(size, lanes, fold)
        return {
            "source": source + SkidBuffer.latency,
            "row_forward": transform,
            "elimination": RowRecurrence.latency,
            "reversal": FrameReversal.latency + (size - 1) * beats * fold,
            "substitution": RowRecurrence.latency + SkidBuffer.latency,
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
        widths = (source_width, data_bits)
        transforms = transform_slices(
            size, lanes, widths, fold=fold, coefficient_width=coefficient_width, dsp=dsp
        )
        recurrences = (
            RowRecurrence.multipliers_of(lanes, width=data_bits, downwards=downwards, dsp=dsp)
            for downwards in (True, False)
        )
        return transforms + sum(recurrences)

    @property
    def stages(self) -> dict[str, int]:
        """Clocks from last beat to last beat of each stage; the first entry counts from the first slopes."""
        source = self.source
        return self.stages_of(source.width, source.lanes, source.source.divergence, fold=self.fold)

    @property
    def frame_latency(self) -> int:
        return sum(self.stages.values())

    @property
    def latency(self) -> int:
        return self.frame_latency - (self.size * self.beats - 1) * self.fold

    @property
    def multipliers(self) -> int:
        parts = (self.row_forward, self.elimination, self.substitution, self.row_inverse)
        return sum(part.multipliers for part in parts)

    def elaborate(self, platform):
        m = Module()
        # Skid buffers where neither neighbour cuts the path of `ready` (transforms and reversal do).
        connect_stages(m, self, ("source", "substitution"))

        beat, last_row = Signal(range(self.beats)), self.size - 1
        row = Signal(range(self.size), init=last_row)
        m.d.comb += self.row.eq(row)
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += beat.eq(beat + 1)
            with m.If(beat == self.beats - 1):
                m.d.sync += [beat.eq(0), row.eq(row - 1)]
                with m.If(row == 0):
                    m.d.sync += row.eq(last_row)
        return m
