"""Fork: one stream copied to several consumers."""

from collections.abc import Sequence

from amaranth import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect


class Fork(wiring.Component):
    """Copy every beat exactly once to each of `ways` outputs, which may accept it in different clocks.

    Members
    -------
    i : stream of `shape`
    o : `ways` streams of `shape`, `o[0]` … `o[ways − 1]`

    `latency` = 0: an output is valid in the same clock as the input, until it has accepted the beat. The
    input beat is accepted in the clock in which the last output accepts it. No `valid` depends
    combinationally on a `ready` of this component; `i.ready` depends on the `ready` of every output.
    Initiation interval: 1 clock if all outputs are ready.
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
        taken = Signal(self.ways)  # outputs that accepted the current beat in an earlier clock
        served = Signal(self.ways)  # those and the outputs that accept it now
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


def fan_out(m: Module, name: str, source, sinks: Sequence) -> None:
    """Connect the stream `source` to all `sinks`, through a Fork, the submodule `name`, to several."""
    if len(sinks) == 1:
        connect(m, source, sinks[0])
        return
    m.submodules[name] = fork = Fork(source.payload.shape(), len(sinks))
    connect(m, source, fork.i)
    for output, sink in zip(fork.o, sinks, strict=True):
        connect(m, output, sink)
