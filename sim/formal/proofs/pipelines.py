# amaranth: UnusedElaboratable=no
"""Proofs of the pipelines: the rules of streams, no beat lost or made up, no deadlock, whatever the resets.

What a pipeline computes has no part in this and is compared with the integers elsewhere, so words are short
and tables small. A pipeline with one clock enable moves as a whole; its stages' valid bits say where its
beats are. One with an output queue moves in every clock, and there is a place in the queue for each beat
inside. Solvers, the force with its patches and the whole datapath are such parts, connected by streams
alone: what holds for every part with any neighbour holds for them together.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from amaranth import Signal, Value

from fastac.gateware.dots.darkness import DarknessStream
from fastac.gateware.fz_stream import PixelResponse
from fastac.gateware.mlp_mvm import MvmTile
from fastac.gateware.network.background import BackgroundSubtraction
from fastac.gateware.network.folded_network import FoldedMlp
from fastac.gateware.network.folded_ratio import FoldedDivider
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.network.requantise import Requantise
from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.gateware.poisson.eigenvalue_division import EigenvalueDivider
from fastac.gateware.poisson.recurrence import RowRecurrence
from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.dst2d import EigenvalueDivision
from fastac.models.integer.force import PatchForce
from fastac.models.integer.network import GradientRatio, Layer, Requantisation
from fastac.models.integer.tridiagonal import Elimination
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.streams import fifo_words

FLAGS = ("saturated", "over")
"""Outputs that belong to the beat that is offered."""


def waits(bench: FormalBench, due: Value, stages: Value, needed: Value | int = 1) -> None:
    """Assert that a beat that is due leaves at the latest when it has passed all `stages`.

    needed : which beat it is, counted from the one that leaves first
    """
    o, latency = bench.dut.o, len(stages)
    waited = bench.waited(due, latency)
    bench.always(
        f"no deadlock: a beat is offered after {latency} clocks", ~due | o.valid | (waited < latency)
    )
    for k in range(1, latency):
        reached = o.valid | ~due | (ones(stages[k:]) >= needed)
        bench.always(f"a beat that waits for {k} clocks is in stage {k}", (waited != k) | reached)


def _opened(component: type, make: Callable[[type], object]) -> tuple[FormalBench, Signal, Signal]:
    """A bench of a pipeline; the valid bits of its stages, and a count of the beats inside."""
    bench = FormalBench(make(component))
    dut = bench.dut
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    for name in FLAGS:
        if name in dut.signature.members:
            flag = getattr(dut, name)
            stable = bench.held(name, dut.o.valid, dut.o.ready, flag)[1]
            bench.always(f"{name} is stable until the beat is taken", stable)
    inside = Signal(range(dut.latency + 2))
    bench.m.d.sync += inside.eq(inside + enters - leaves)
    return bench, bench.probe("valid", dut.latency), inside


def pipeline(component: type, make: Callable[[type], object]) -> FormalBench:
    """A beat leaves for each that enters, after all of the stages; all stages move together."""
    bench, valid, inside = _opened(component, make)
    dut = bench.dut
    bench.always("no beat lost or made up: inside are those in the stages", inside == ones(valid))
    bench.always("offered is the last stage's beat", dut.o.valid == valid[-1])
    bench.always(
        "no deadlock: takes a beat when its last stage moves on", dut.i.ready == (dut.o.ready | ~dut.o.valid)
    )
    waits(bench, inside != 0, valid)
    return bench


def queued_pipeline(component: type, make: Callable[[type], object]) -> FormalBench:
    """A beat leaves for each that enters; the stages move in every clock, and none without a place behind.

    A folded pipeline takes a beat only when none is in the first fold − 1 of its stages. One whose kernels
    are read first takes none in the first `start` clocks after a reset.
    """
    bench, valid, inside = _opened(component, make)
    dut = bench.dut
    fold = getattr(dut, "fold", 1)
    depth = dut.latency // fold + 1
    flags = len(dut.over) if "over" in dut.signature.members else 0
    level, _ = fifo_words(bench, "queue.queue.queue", depth, len(Value.cast(dut.o.payload)) + flags)
    credits, full = bench.probe("queue.under_way", range(depth + 1)), bench.probe("queue.full")
    bench.always(
        "no beat lost or made up: inside are those in the stages and in the queue",
        inside == ones(valid) + level,
    )
    bench.always("a credit for each beat inside", credits == inside)
    bench.always("no beat without a place in the queue", (inside <= depth) & (full == (inside == depth)))
    bench.always("no deadlock: what is there is offered", dut.o.valid == (valid[-1] | (level != 0)))
    start = getattr(dut, "start", 0)
    clock = bench.clocks(start)
    if start:
        bench.always("a kernel is there from then on", bench.probe("kernels.ready") == (clock == start))
    free = ~valid[: fold - 1].any() & (clock == start)
    bench.always(
        "no deadlock: takes a beat while there is a place", dut.i.ready == (free & (inside != depth))
    )
    waits(bench, inside != 0, valid)
    return bench


def _tile(component: type):
    layer = Layer(np.array([[1, -2], [3, 1]]), np.array([1, -1]), np.array([1, 1]), 3, loadable=True)
    return component(layer, input_width=1, input_signed=False)


def _network(component: type, **options: int):
    limit, scale = np.array([1]), Requantisation(np.array([1]), 0, 1)
    layers = (
        Layer(np.array([[1]]), np.array([0]), limit, 2, scale),
        Layer(np.array([[1], [0], [1]]), np.array([0, 0, 1]), limit, 2),
    )
    return component(layers, input_width=2, **options)


def _background(component: type):
    codes = np.array([-1, 1])
    return component(2, 2, 1, codes, codes, np.full((2, 2, 1), 3, np.uint8), lanes=1)


def _levelled(component: type):
    rest = np.full((2, 4, 1), 100, np.uint8)
    return component(2, 4, 1, np.array([-1, 1, 2, 3]), np.array([-1, 1]), rest, lanes=1, level_light=True)


def _division(component: type):
    shift = 16 + np.add.outer(np.arange(3), np.arange(3))
    return component(EigenvalueDivision(np.full((3, 3), 1 << 16), shift, 2, 3), lanes=2)


def _depth(component: type):
    return component(Depth("difference", 2, np.eye(3, dtype=int)), lanes=2)


def _displacement(component: type):
    depth = Depth("absolute", 2, np.eye(3, dtype=int))
    return component(depth, DisplacementQuantiser(depth.width, 0, 1), lanes=2)


EVERY_CLOCK = "with m.If(1):\n"
RETURN = "        return m\n"
EARLY = (RETURN, f"        m.d.comb += self.o.valid.eq(1)\n{RETURN}")
QUEUED = ((RETURN, f"        m.d.comb += self.i.ready.eq(1)\n{RETURN}"), EARLY)
"""Faults of a handshake with a queue: beats enter without a place, and leave before they are there."""


def _unheld(text: str) -> tuple[str, str]:
    """Registers that move while the pipeline is stalled."""
    return f"with m.If(advance):\n{text}", f"{EVERY_CLOCK}{text}"


PIPELINES = (
    (
        "background",
        BackgroundSubtraction,
        _background,
        "2 × 2 pixels of one channel",
        (_unheld("            for lane"),),
    ),
    (
        "background_level_light",
        BackgroundSubtraction,
        _levelled,
        "2 × 4 pixels of one channel, whose light is levelled",
        (_unheld("            for lane"),),
    ),
    (
        "darkness",
        DarknessStream,
        lambda component: component(DotWindows(np.ones((2, 2), int), 1, 1), lanes=1),
        "8 × 8 pixels of one channel",
        (_unheld("                m.d.sync += self.o.payload[lane]"),),
    ),
    ("tile", MvmTile, _tile, "two neurons of two inputs, loadable", QUEUED),
    (
        "requantise",
        Requantise,
        lambda component: component(Requantisation(np.array([3]), 1, 2), width=3),
        "one neuron",
        QUEUED,
    ),
    (
        "network",
        NormalMlp,
        partial(_network, lanes=1),
        "two layers of one input",
        (EARLY,),
    ),
    (
        "folded_network",
        FoldedMlp,
        partial(_network, fold=4),
        "two layers of one input, a pixel every 4 clocks",
        QUEUED,
    ),
    (
        "folded_divider",
        FoldedDivider,
        lambda component: component(GradientRatio(3, 3, 1), fold=4),
        "slopes of 3 bits, a normal every 4 clocks",
        QUEUED,
    ),
    (
        "gradient_divider_stream",
        GradientDivider,
        lambda component: component(GradientRatio(3, 3, 1), lanes=1),
        "slopes of 3 bits",
        QUEUED,
    ),
    (
        "eigenvalue_division",
        EigenvalueDivider,
        _division,
        "3 × 3 coefficients, two a beat",
        QUEUED,
    ),
    (
        "recurrence",
        RowRecurrence,
        lambda component: component(Elimination(np.full((5, 5), 1), 1, 1, 2), lanes=1),
        "5 × 5 values",
        (_unheld("                    m.d.sync += held.eq(value)"),),
    ),
    (
        "depth",
        DepthOutput,
        _depth,
        "3 × 3 depths, two a beat",
        (_unheld("            m.d.sync += [depth[k]"),),
    ),
    (
        "displacement",
        Displacement,
        _displacement,
        "3 × 3 displacements, two a beat",
        (
            _unheld("                m.d.sync += [\n                    rounded"),
            ("with m.If(self.o.valid & self.o.ready)", "with m.If(self.o.valid)"),
        ),
    ),
    (
        "pixel_response",
        PixelResponse,
        lambda component: component(PatchForce(np.ones((1, 3, 3, 3, 3), int), 2, 1), lanes=1),
        "kernels of 3 × 3 weights",
        QUEUED,
    ),
)

PROOFS = (
    *(
        Proof(
            name,
            component,
            f"{size}, in words of few bits; words and tables have no part in the handshake",
            partial(queued_pipeline if EARLY in breaks else pipeline, make=make),
            depth=2 + component.start if hasattr(component, "start") else 1,
            breaks=breaks,
            broken_depth=20 if "network" in name else 16,
            quick=name in ("displacement", "tile"),
        )
        for name, component, make, size, breaks in PIPELINES
    ),
)
