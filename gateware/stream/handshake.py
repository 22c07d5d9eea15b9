"""The valid/ready handshake of a pipeline, the AXI4-Stream signature, and the allowed numbers of lanes."""

from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


def axis_signature(width: int) -> wiring.Signature:
    """AXI4-Stream with `width` bits of `tdata` and one bit of `tuser`, seen from the master."""
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
"""The numbers of pixels per clock that the hardware can be built for."""


def check_lanes(lanes: int) -> None:
    """Raise ValueError unless `lanes` is one of LANES."""
    if lanes not in LANES:
        raise ValueError(f"lanes {lanes}: expected one of {LANES}")


def pipeline_handshake(m: Module, i, o, latency: int) -> Signal:
    """Add valid bits and back-pressure for a pipeline of `latency` registers between the streams `i` and `o`.

    Returns `advance`, the clock enable of all the pipeline's registers: high while `o` is ready or its
    register is empty. So only back-pressure from `o` stalls the pipeline, and all stages stall together.
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
