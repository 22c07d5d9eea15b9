"""The valid/ready handshake of a pipeline, the AXI4-Stream signature, and the allowed numbers of lanes."""

from amaranth import Cat, Const, Module, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.scenes.pace import FOLDS


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


def pace(m: Module, step, fold: int, name: str = "pace") -> Signal | Const:
    """High while a beat may move that moves at most every `fold` clocks.

    step : high in the clock in which it moves, only while the result is high
    name : of the counter of the clocks since
    """
    if fold == 1:
        return Const(1)
    since = Signal(range(fold), init=fold - 1, name=name)
    due = since == fold - 1
    with m.If(step):
        m.d.sync += since.eq(0)
    with m.Elif(~due):
        m.d.sync += since.eq(since + 1)
    return due


def check_fold(fold: int, lanes: int) -> None:
    """Raise ValueError unless `fold` is one of FOLDS, and 1 with several lanes."""
    if fold not in FOLDS:
        raise ValueError(f"fold {fold}: expected one of {FOLDS}")
    if fold > 1 and lanes > 1:
        raise ValueError(f"fold {fold}: expected 1 with lanes = {lanes}")


def check_folded(fold: int) -> None:
    """Raise ValueError unless `fold` is one of FOLDS above 1."""
    if fold not in FOLDS[1:]:
        raise ValueError(f"fold {fold}: expected one of {FOLDS[1:]}")


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
