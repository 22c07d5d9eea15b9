"""Proofs of the parts that move beats without changing them: fork, skid buffer, credit queue."""

from functools import partial

from amaranth import Array, Cat, Signal, Value, unsigned

from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.queues import BypassQueue, CreditQueue, SkidBuffer
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.in_order import InOrder
from fastac.sim.formal.proof import Proof

WAYS = 3
PAYLOAD = unsigned(3)


def fork(component: type) -> FormalBench:
    """Every beat reaches each output once, in order: outputs are ahead of the input by at most one beat."""
    bench = FormalBench(component(PAYLOAD, WAYS))
    moves, payload = bench.source(bench.dut.i, "i")
    taken = bench.probe("taken", WAYS)
    waits = Signal()  # the beat at the input was there a clock ago
    bench.m.d.sync += waits.eq(bench.dut.i.valid & ~moves)
    for k, port in enumerate(bench.dut.o):
        took = bench.sink(port, f"o_{k}")
        ahead = Signal(name=f"ahead_{k}")  # the output has the beat that waits at the input
        bench.m.d.sync += ahead.eq((ahead | took) & ~moves)
        bench.always(f"o_{k}: no beat twice", ~(took & ahead))
        bench.always(f"o_{k}: no beat is lost", ~moves | took | ahead)
        bench.always(f"o_{k}: the input's payload", ~took | (port.payload == payload))
        bench.always(f"o_{k}: waits for no other output", ahead | (port.valid == bench.dut.i.valid))
        bench.always(f"o_{k}: `taken` is what it has", taken[k] == ahead)
        bench.always(f"o_{k}: has a beat only while the beat waits", waits | ~ahead)
    all_ready = Cat(port.ready for port in bench.dut.o).all()
    bench.always("no deadlock: a beat goes on when all outputs are ready", ~all_ready | bench.dut.i.ready)
    return bench


def fifo_words(
    bench: FormalBench, path: str, depth: int, width: int, name: str = "the FIFO"
) -> tuple[Value, list[Value]]:
    """Level and words, the oldest first, of the SyncFIFO `path`; asserts that its pointers fit its level."""
    level = bench.probe(f"{path}.level", range(depth + 1))
    produce, consume = (bench.probe(f"{path}.{end}", range(depth)) for end in ("produce", "consume"))
    rows = [bench.probe(f"{path}.storage[{k}]", width) for k in range(depth)]
    if depth > 1:
        bench.always(f"{name}'s pointers are in it", (produce < depth) & (consume < depth))
        apart = Signal(range(2 * depth))
        bench.m.d.comb += apart.eq(consume + level)
        bench.always(
            f"{name}'s pointers fit its level", produce == apart - depth * (apart >= depth).as_unsigned()
        )
    bench.always(f"{name} holds at most its depth", level <= depth)
    memory = Array(rows)
    return level, [memory[(consume + k) % depth] for k in range(depth)]


def skid_buffer(component: type) -> FormalBench:
    """Beats leave as they entered; no deadlock, and `ready` comes from a register."""
    bench = FormalBench(component(PAYLOAD))
    enters, payload = bench.source(bench.dut.i, "i")
    leaves = bench.sink(bench.dut.o, "o")
    track = InOrder(bench, enters, payload, leaves, bench.dut.o.payload, capacity=2)
    level, words = fifo_words(bench, "queue", 2, len(payload))
    track.stored(bench, words)
    bench.always("inside are the FIFO's beats", track.inside == level)
    bench.always("no deadlock: what is inside is offered", bench.dut.o.valid == (track.inside != 0))
    bench.always("no deadlock: takes a beat while it has room", bench.dut.i.ready == (track.inside != 2))
    return bench


def bypass_queue(component: type, depth: int) -> FormalBench:
    """Beats leave as they entered, in the same clock where nothing is in the way; no deadlock."""
    bench = FormalBench(component(PAYLOAD, depth=depth))
    enters, payload = bench.source(bench.dut.i, "i")
    leaves = bench.sink(bench.dut.o, "o")
    track = InOrder(bench, enters, payload, leaves, bench.dut.o.payload, capacity=depth)
    level, words = fifo_words(bench, "queue", depth, len(payload))
    track.stored(bench, words)
    bench.always("inside are the FIFO's beats", track.inside == level)
    offers = (track.inside != 0) | bench.dut.i.valid
    bench.always("no clock is lost: what is there is offered", bench.dut.o.valid == offers)
    bench.always("no deadlock: takes a beat while it has room", bench.dut.i.ready == (track.inside != depth))
    return bench


def credit_queue(component: type, depth: int) -> FormalBench:
    """Beats leave as they entered, and no beat arrives without room, behind a pipeline of any length."""
    bench = FormalBench(component(PAYLOAD, depth=depth))
    dut, m = bench.dut, bench.m
    launch, arrives = bench.free("launch"), bench.free("arrives")
    payload = bench.free("payload", PAYLOAD)
    under_way = Signal(range(depth + 2))  # in the pipeline
    m.d.sync += under_way.eq(under_way + launch - arrives)
    bench.assume(~launch | dut.room)
    bench.assume(~arrives | (under_way != 0))
    for port, value in ((dut.launch, launch), (dut.i_valid, arrives), (dut.i, payload)):
        bench.drive(port, value)
    leaves = bench.sink(dut.o, "o")
    track = InOrder(bench, arrives, payload, leaves, dut.o.payload, capacity=depth)
    level, words = fifo_words(bench, "queue.queue", depth, len(payload))
    track.stored(bench, words)
    credits = bench.probe("under_way", range(depth + 1))
    bench.always("inside are the FIFO's beats", track.inside == level)
    bench.always("a credit for each beat under way or inside", credits == under_way + level)
    bench.always("at most as many as places", under_way + level <= depth)
    bench.always("no deadlock: room while a credit is free", dut.room == (credits != depth))
    bench.always("no deadlock: what is inside is offered", dut.o.valid == (arrives | (track.inside != 0)))
    return bench


PROOFS = (
    Proof(
        "fork",
        Fork,
        "three outputs of 3 bits; outputs are alike and payloads are only wired through",
        fork,
        depth=2,
        breaks=(
            ("self.i.valid & ~taken[k]", "self.i.valid"),
            ("taken[k] | o.ready", "o.ready"),
            ("Mux(served.all(), 0, served)", "served"),
            ("o.payload.eq(self.i.payload)", "o.payload.eq(self.i.payload | 1)"),
        ),
        quick=True,
    ),
    Proof(
        "skid_buffer",
        SkidBuffer,
        "3 bits; payloads are only stored",
        skid_buffer,
        depth=2,
        breaks=(
            ("queue.w_en.eq(self.i.valid)", "queue.w_en.eq(1)"),
            ("queue.r_en.eq(self.o.ready)", "queue.r_en.eq(1)"),
            ("self.i.ready.eq(queue.w_rdy)", "self.i.ready.eq(1)"),
            ("self.o.valid.eq(queue.r_rdy)", "self.o.valid.eq(queue.r_rdy & self.o.ready)"),
        ),
        quick=True,
    ),
    Proof(
        "bypass_queue",
        BypassQueue,
        "two beats of 3 bits; payloads are only stored",
        partial(bypass_queue, depth=2),
        depth=2,
        breaks=(
            ("(queue.r_rdy | ~self.o.ready)", "~self.o.ready"),
            ("(queue.r_rdy | ~self.o.ready)", "1"),
            ("queue.r_rdy | self.i.valid", "queue.r_rdy"),
            ("Mux(queue.r_rdy, queue.r_data, self.i.payload)", "queue.r_data"),
        ),
        quick=True,
    ),
    *(
        Proof(
            f"credit_queue_{depth}",
            CreditQueue,
            f"depth {depth}, 3 bits, behind a pipeline of any length",
            partial(credit_queue, depth=depth),
            depth=2,
            breaks=(
                ("following == self.depth", "following == self.depth + 1"),
                ("under_way + self.launch - taken", "under_way + self.launch - self.o.valid"),
                ("queue.i.valid.eq(self.i_valid)", "queue.i.valid.eq(self.i_valid & self.room)"),
                ("queue.i.payload.eq(self.i)", "queue.i.payload.eq(self.i | 1)"),
            ),
            quick=depth == 2,
        )
        for depth in (2, 4)
    ),
)
