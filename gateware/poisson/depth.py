"""Outputs of the Poisson solver: depth, and quantised displacement relative to the state at rest."""

import numpy as np
from amaranth import Module, Mux, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_lanes, pipeline_handshake
from fastac.gateware.stream.tables import RasterRom, TableFormat, raster_beats
from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.words import signed_width


def _check(depth: Depth, lanes: int) -> None:
    check_lanes(lanes)
    if depth.rest.ndim != 2 or depth.rest.shape[0] != depth.rest.shape[1]:
        raise ValueError(f"rest {depth.rest.shape}: expected square")


def _beside(m: Module, component, advance, rest: RasterRom) -> tuple[list[Signal], list]:
    """Add the ROM `rest`; returns the lanes of `component.i`, delayed by the ROM's latency, and the ROM's."""
    m.submodules.rest = rest
    m.d.comb += [rest.advance.eq(advance), rest.take.eq(component.i.valid)]
    z = list(component.i.payload)
    for stage in range(RasterRom.latency):
        delayed = [Signal.like(x, reset_less=True, name=f"z{stage}_{k}") for k, x in enumerate(z)]
        with m.If(advance):
            m.d.sync += [d.eq(x) for d, x in zip(delayed, z, strict=True)]
        z = delayed
    return z, list(rest.word)


class DepthOutput(wiring.Component):
    """Solutions z to depth, z in mode "absolute" or rest + z in mode "difference", bit-exact to `depth`.

    Members
    -------
    i : stream of `lanes` solutions, signed(depth.input_width)
    o : stream of `lanes` depths, signed(depth.width)

    A frame is N rows of ceil(N/lanes) beats; the lanes beyond N are undefined. The depth at rest is a ROM,
    which exists only in mode "difference" if it is not zero everywhere. `latency` = 1 clock, 3 with the ROM,
    without back-pressure; initiation interval 1.
    """

    def __init__(self, depth: Depth, *, lanes: int):
        _check(depth, lanes)
        self.depth, self.lanes = depth, lanes
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(depth.input_width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(depth.width), lanes))),
            }
        )

    @property
    def has_rom(self) -> bool:
        return self.depth.mode == "difference" and bool(self.depth.rest.any())

    @staticmethod
    def latency_of(*, has_rom: bool) -> int:
        return 1 + (RasterRom.latency if has_rom else 0)

    @property
    def latency(self) -> int:
        return self.latency_of(has_rom=self.has_rom)

    def elaborate(self, platform):
        m = Module()
        advance = pipeline_handshake(m, self.i, self.o, self.latency)

        if self.has_rom:
            bits = signed_width(int(np.abs(self.depth.rest).max()))
            rom = RasterRom(raster_beats(self.depth.rest, self.lanes), bits)
            z, rest = _beside(m, self, advance, rom)
        else:
            z, rest = list(self.i.payload), [0] * self.lanes
        depth = Signal(self.o.payload.shape(), reset_less=True)
        m.d.comb += self.o.payload.eq(depth)
        with m.If(advance):
            m.d.sync += [depth[k].eq(rest[k] + z[k]) for k in range(self.lanes)]
        return m


class Displacement(wiring.Component):
    """Solutions z to quantised displacement: rest − z in mode "absolute", −z in mode "difference".

    Bit-exact to `quantiser(depth(z)[1])`.

    Members
    -------
    i : stream of `lanes` solutions, signed(depth.input_width)
    o : stream of `lanes` displacements, unsigned(quantiser.bits), or signed if the quantiser does not clamp
    saturated : high while `o` offers a beat in which a displacement is clipped to ±quantiser.top
    over : one bit per lane of the offered beat: its displacement is clipped
    rest : write port of the depth at rest, see `TableFormat`; must not be used while a frame is in flight.
        Only in mode "absolute" with `loadable`; the memory then holds any rest of a depth of this width.

    A frame is N rows of ceil(N/lanes) beats; the lanes beyond N are undefined. In mode "absolute" a ROM holds
    the depth at rest plus the rounding constant. `latency` = 2 clocks (difference, clip), 4 with the ROM,
    without back-pressure; initiation interval 1.
    """

    def __init__(self, depth: Depth, quantiser: DisplacementQuantiser, *, lanes: int, loadable: bool = False):
        _check(depth, lanes)
        if quantiser.input_width != depth.width:
            raise ValueError(f"quantiser.input_width {quantiser.input_width}: expected {depth.width}")
        self.depth, self.quantiser, self.lanes = depth, quantiser, lanes
        word = Shape(quantiser.bits, signed=not quantiser.clamp)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(signed(depth.input_width), lanes))),
            "o": Out(stream.Signature(data.ArrayLayout(word, lanes))),
            "saturated": Out(1),
            "over": Out(lanes),
        }
        self.loadable = loadable and self.has_rom
        if self.loadable:
            members["rest"] = In(self.table.signature)
        super().__init__(members)

    @property
    def has_rom(self) -> bool:
        return self.depth.mode == "absolute"

    @staticmethod
    def latency_of(*, has_rom: bool) -> int:
        return 2 + (RasterRom.latency if has_rom else 0)

    @property
    def latency(self) -> int:
        return self.latency_of(has_rom=self.has_rom)

    @property
    def table_values(self) -> np.ndarray:
        """The depth at rest plus the rounding constant, (beats, lanes); unused lanes are zero."""
        return raster_beats(self.depth.rest + (1 << self.quantiser.shift >> 1), self.lanes)

    @property
    def table(self) -> TableFormat:
        """Format of the ROM; if loadable, depth.width bits, which hold any rest plus the constant."""
        values = self.table_values
        own_bits = signed_width(int(np.abs(values).max()))
        return TableFormat(len(values), self.lanes, self.depth.width if self.loadable else own_bits)

    @property
    def _rounded_width(self) -> int:
        """Bits of the rounded displacement: bits of its largest sum minus the `shift` bits dropped."""
        half = 1 << self.quantiser.shift >> 1
        rest = int(np.abs(self.depth.rest).max()) if self.has_rom else 0
        if self.loadable:
            rest = 1 << (self.depth.width - 1)
        return signed_width((1 << (self.depth.input_width - 1)) + rest + half) - self.quantiser.shift

    def elaborate(self, platform):
        m = Module()
        advance = pipeline_handshake(m, self.i, self.o, self.latency)

        shift, top = self.quantiser.shift, self.quantiser.top
        half = 1 << shift >> 1
        if self.has_rom:
            rom = RasterRom(self.table_values, self.table.bits, loadable=self.loadable)
            if self.loadable:
                wiring.connect(m, wiring.flipped(self.rest), rom.write)
            z, rest = _beside(m, self, advance, rom)
        else:
            z, rest = list(self.i.payload), [half] * self.lanes

        # A negative displacement rounds to 0 or below, so it may be clamped after rounding.
        low = 0 if self.quantiser.clamp else -top
        displacement = Signal(self.o.payload.shape(), reset_less=True)
        over = Signal(self.lanes, reset_less=True)
        for k in range(self.lanes):
            rounded = Signal(signed(self._rounded_width), reset_less=True, name=f"rounded_{k}")
            above, below = rounded > top, rounded < low
            with m.If(advance):
                m.d.sync += [
                    rounded.eq((rest[k] - z[k]) >> shift),
                    over[k].eq(above if self.quantiser.clamp else above | below),
                    displacement[k].eq(Mux(below, low, Mux(above, top, rounded))),
                ]
        m.d.comb += [
            self.o.payload.eq(displacement),
            self.over.eq(over & self._present(m)),
            self.saturated.eq(self.o.valid & self.over.any()),
        ]
        return m

    def _present(self, m: Module):
        """Mask of the lanes of the offered beat that are not beyond the end of a row."""
        n = len(self.depth.rest)
        beats = -(-n // self.lanes)
        if n % self.lanes == 0:
            return (1 << self.lanes) - 1
        beat = Signal(range(beats))
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += beat.eq(Mux(beat == beats - 1, 0, beat + 1))
        return Mux(beat == beats - 1, (1 << n % self.lanes) - 1, (1 << self.lanes) - 1)
