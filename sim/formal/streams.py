"""Proofs of the parts that move beats without changing them: fork, queues."""

from amaranth import Cat, Signal, unsigned

from fastac.gateware.stream.fork import Fork
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

WAYS = 3


def fork(component: type) -> FormalBench:
    """Every beat reaches each output once, in order: outputs are ahead of the input by at most one beat."""
    bench = FormalBench(component(unsigned(4), WAYS))
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


PROOFS = (
    Proof(
        "fork",
        Fork,
        "three outputs of 4 bits; outputs are alike and payloads are only wired through",
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
)
