# amaranth: UnusedElaboratable=no
"""Which pixels are dark, kept until their slopes have been found."""

from amaranth import Cat, Module, unsigned
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.dot_windows import DotWindows


class DarkQueue(wiring.Component):
    """A queue of `depth` beats of which pixels are dark, that is, of a darkness above 0.

    Members
    -------
    i : stream of the darkness of `lanes` pixels, see `DarknessStream.o`
    o : stream of `lanes` bits

    `latency` = 1 clock, initiation interval 1.
    """

    latency = 1

    def __init__(self, windows: DotWindows, *, lanes: int, depth: int):
        self.lanes, self.depth = lanes, depth
        darkness = data.ArrayLayout(unsigned(windows.darkness_width), lanes)
        super().__init__({"i": In(stream.Signature(darkness)), "o": Out(stream.Signature(lanes))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFO(width=self.lanes, depth=self.depth)
        m.d.comb += [
            queue.w_data.eq(Cat(value != 0 for value in self.i.payload)),
            queue.w_en.eq(self.i.valid),
            self.i.ready.eq(queue.w_rdy),
            self.o.payload.eq(queue.r_data),
            self.o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.o.ready),
        ]
        return m
