"""What every pipelined component does between its streams: how it moves, and how many pixels at once."""

from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


def axis_signature(width: int) -> wiring.Signature:
    """An AXI4-Stream of `width` bits of data, seen from the side that sends."""
    return wiring.Signature(
        {
            "tdata": Out(unsigned(width)),
            "tvalid": Out(1),
            "tready": In(1),
            "tlast": Out(1),
            "tuser": Out(1),
        }
    )


LANES = (1, 2, 4)
"""Pixels a clock that the hardware is built for."""


def check_lanes(lanes: int) -> None:
    """Raise ValueError unless `lanes` is one of LANES."""
    if lanes not in LANES:
        raise ValueError(f"lanes {lanes}: expected one of {LANES}")


def pipeline_handshake(m: Module, i, o, latency: int) -> Signal:
    """Connect valid and ready of a core of `latency` registers between the streams `i` and `o`.

    Returns `advance`: the core's registers move in clocks in which it is high. The core never stalls by
    itself; it moves whenever its last register may move.
    """
    advance = Signal()
    valid = Signal(latency)
    m.d.comb += [
        advance.eq(o.ready | ~o.valid),
        i.ready.eq(advance),
        o.valid.eq(valid[-1]),
    ]
    with m.If(advance):
        m.d.sync += valid.eq(Cat(i.valid, valid))
    return advance
