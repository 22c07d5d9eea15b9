"""One stream to several readers."""

from amaranth import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out


class Fork(wiring.Component):
    """Deliver every beat exactly once to each of `ways` outputs, which may take it at different times.

    Members
    -------
    i : stream of `shape`
    o : `ways` streams of `shape`, `o[0]` … `o[ways − 1]`

    `latency` is 0: an output offers a beat in the clock in which the input does, and no longer after it has
    taken it; the input is taken in the clock in which the last output takes it. No `valid` depends on any
    `ready` of this component; `i.ready` depends on every output's. One beat a clock passes if all are ready.
    """

    latency = 0

    def __init__(self, shape, ways: int):
        if ways < 1:
            raise ValueError(f"ways {ways}: expected at least 1")
        self.ways = ways
        super().__init__(
            {
                "i": In(stream.Signature(shape)),
                "o": Out(stream.Signature(shape)).array(ways),
            }
        )

    def elaborate(self, platform):
        m = Module()
        taken = Signal(self.ways)  # outputs that have already taken the offered beat
        served = Signal(self.ways)  # and those that take it now
        m.d.comb += self.i.ready.eq(served.all())
        for k, o in enumerate(self.o):
            m.d.comb += [
                o.payload.eq(self.i.payload),
                o.valid.eq(self.i.valid & ~taken[k]),
                served[k].eq(taken[k] | o.ready),
            ]
        with m.If(self.i.valid):
            m.d.sync += taken.eq(Mux(served.all(), 0, served))
        return m
