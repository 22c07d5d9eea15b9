# amaranth: UnusedElaboratable=no
"""The valid/ready handshake of a pipeline, the AXI4-Stream signature, and the allowed numbers of lanes.

A pipeline has one of two handshakes. `pipeline_handshake` costs a gate, and its `advance` is the clock enable
of all registers: for pipelines of few registers (background, darkness, depth, recurrence), and where the last
register is a sum that stays until it is taken (the weighted sums). `credit_handshake` costs a queue as deep
as the pipeline, and no register has a clock enable: for the long and wide ones (network, divider, division
by eigenvalues, responses of patches). FeatureSmoothing has its own: beats that it holds are in a memory of
rows, and leave only as others enter, or by themselves between frames.
"""

from amaranth import Cat, Const, Module, Signal, Value, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.queues import CreditQueue
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


def credit_handshake(
    m: Module, i, o, latency: int, *, fold: int = 1, flags: Value | None = None, start: Value | None = None
) -> tuple[data.View, list[Value]]:
    """Add valid bits, an output queue and back-pressure for a pipeline without clock enables between streams.

    The pipeline has `latency` registers and takes a beat at most every `fold` clocks. A beat enters only
    while the queue (CreditQueue, a submodule of `m`) has a place for it, so the registers never stall:
    `i.ready` comes from registers and `o.ready` goes to the queue alone. A beat that finds the queue empty
    passes it in the same clock. The queue holds one beat more than the pipeline has inside at its highest
    rate, so that back-pressure stops it hardly later than it would stop a pipeline without a queue.

    flags : output beside `o` that belongs to the beat that `o` offers, if any
    start : low as long as no beat may enter after a reset, if any may not

    Returns what the pipeline's last registers drive, a view with `payload`, shaped as that of `o`, and
    `flags`; and for 0 to `latency` clocks whether a beat has entered so many of them ago.
    """
    valid = Signal(latency)
    enters = Signal()
    layout = {"payload": o.payload.shape(), "flags": unsigned(0 if flags is None else len(flags))}
    depth = latency // fold + 1
    m.submodules.queue = queue = CreditQueue(data.StructLayout(layout), depth=depth)
    m.d.comb += [
        i.ready.eq(queue.room & ~valid[: fold - 1].any() & (Const(1) if start is None else start)),
        enters.eq(i.valid & i.ready),
        queue.launch.eq(enters),
        queue.i_valid.eq(valid[-1]),
        o.valid.eq(queue.o.valid),
        queue.o.ready.eq(o.ready),
        o.payload.eq(queue.o.payload.payload),
    ]
    if flags is not None:
        m.d.comb += flags.eq(queue.o.payload.flags)
    m.d.sync += valid.eq(Cat(enters, valid))
    return queue.i, [enters, *valid]
