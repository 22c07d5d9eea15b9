"""How much darker than the skin at rest each pixel is, from which dots are found."""

import numpy as np
from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import adder_tree, tree_levels
from fastac.gateware.dots.multiple import multiple
from fastac.gateware.stream.handshake import check_lanes, pipeline_handshake
from fastac.gateware.stream.tables import TableFormat
from fastac.models.integer.dot_windows import BLOCK, DotWindows
from fastac.models.integer.words import signed_width


class DarknessStream(wiring.Component):
    """Subtract the sum of each pixel's channels from its threshold, bit-exact to `windows.darkness(frames)`.

    Members
    -------
    i : stream of `lanes` pixels of `windows.channels` × unsigned(8), frames of H × W pixels in raster order
    o : stream of `lanes` values, unsigned(windows.darkness_width)
    threshold : write port of the thresholds' memory, one word for each block of pixels in raster order, see
        `TableFormat`, of 0 to `windows.brightest`; must not be used while a frame is in flight. Only if
        `windows.loadable`.

    `latency` = 1 + ceil(log2(channels)) clocks, at least 2, without back-pressure: adder tree, difference.
    Initiation interval: 1 clock per beat.
    """

    multipliers = 0

    def __init__(self, windows: DotWindows, *, lanes: int):
        check_lanes(lanes)
        self.windows, self.lanes = windows, lanes
        height, width = windows.image
        self.row_beats, self.rows = width // lanes, height
        self.table = TableFormat(windows.threshold.size, 1, signed_width(windows.darkest))
        pixel = data.ArrayLayout(unsigned(8), windows.channels)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
            "o": Out(stream.Signature(data.ArrayLayout(unsigned(windows.darkness_width), lanes))),
        }
        if windows.loadable:
            members["threshold"] = In(self.table.signature)
        super().__init__(members)

    @property
    def table_values(self) -> np.ndarray:
        """The thresholds in the order of the memory, (blocks, 1)."""
        return self.windows.threshold.reshape(-1, 1)

    @staticmethod
    def latency_of(channels: int) -> int:
        return 1 + max(1, tree_levels(channels))

    @property
    def latency(self) -> int:
        return self.latency_of(self.windows.channels)

    def elaborate(self, platform):
        m = Module()
        advance = pipeline_handshake(m, self.i, self.o, self.latency)
        x = Signal(range(self.row_beats))
        y = Signal(range(self.rows))
        with m.If(advance & self.i.valid):
            m.d.sync += x.eq(x + 1)
            with m.If(x == self.row_beats - 1):
                m.d.sync += [x.eq(0), y.eq(Mux(y == self.rows - 1, 0, y + 1))]

        m.submodules.table = table = memory.Memory(
            shape=signed(self.table.bits), depth=self.table.depth, init=self.table_values[:, 0].tolist()
        )
        if self.windows.loadable:
            port = table.write_port()
            m.d.comb += [
                port.en.eq(self.threshold.en),
                port.addr.eq(self.threshold.addr),
                port.data.eq(self.threshold.data),
            ]
        read = table.read_port()
        blocks = self.windows.threshold.shape[1]
        row, column = multiple(y // BLOCK, blocks), multiple(x, self.lanes) // BLOCK
        m.d.comb += [read.addr.eq(row + column), read.en.eq(advance)]

        def register(value, name: str) -> Signal:
            held = Signal.like(value, reset_less=True, name=name)
            with m.If(advance):
                m.d.sync += held.eq(value)
            return held

        levels, threshold = tree_levels(self.windows.channels), read.data
        for stage in range(1, levels):
            threshold = register(threshold, f"threshold_{stage}")
        for lane, pixel in enumerate(self.i.payload):
            bounds = np.full((1, self.windows.channels), 255)
            bright = adder_tree(m, advance, list(pixel), bounds, f"bright_{lane}")
            if not levels:
                bright = register(bright, f"bright_{lane}")
            lacking = threshold - bright
            with m.If(advance):
                m.d.sync += self.o.payload[lane].eq(Mux(lacking < 0, 0, lacking))
        return m
