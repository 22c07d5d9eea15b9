# amaranth: UnusedElaboratable=no
"""Proofs of the engines that gather rows or frames: sine transform, Poisson source, weighted sum.

As in `pipelines`: the rules of streams, no beat lost or made up, no deadlock, whatever the resets.
"""

from functools import partial

import numpy as np
from amaranth import Array, Cat, Const, Mux, Signal, Value

from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.gateware.dst1_engine import Dst1Engine
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.poisson.source import PoissonSourceStream
from fastac.models.integer.dot_windows import BLOCK, CELL, DotWindows
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.frame_order import FrameCounter
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.pipelines import waits
from fastac.sim.formal.proofs.streams import fifo_words


def transform(component: type, size: int, lanes: int) -> FormalBench:
    """Each row that enters leaves as a row; never is a beat under way without a place in the queue."""
    rows = np.array([[(k + 1) * (n + 1) for n in range(size)] for k in range(size)])
    matrix = np.rint(2 * np.sin(np.pi * rows / (size + 1))).astype(int)
    bench = FormalBench(component(SineTransform(matrix, 1, 1, 4), lanes=lanes))
    dut, beats = bench.dut, bench.dut.interval
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered, left = FrameCounter(bench, "in", enters, beats), FrameCounter(bench, "out", leaves, beats)

    valid = bench.probe("valid", dut.latency - 1)
    depth = 1 << len(valid).bit_length()
    level, _ = fifo_words(bench, "queue.queue.queue", depth, len(Value.cast(dut.o.payload)))
    credits, full = bench.probe("queue.under_way", range(depth + 1)), bench.probe("queue.full")
    beat, step = bench.probe("beat", range(beats)), bench.probe("step", range(beats))
    following = bench.probe("following", range(beats))
    active, last_beat, last_step = (bench.probe(name) for name in ("active", "last_beat", "last_step"))
    bench.always("a credit for each beat under way or in the queue", credits == ones(valid) + level)
    bench.always("no beat without a place in the queue", (credits <= depth) & (full == (credits == depth)))
    place, row = left.after(credits)
    bench.always("each row leaves as it was launched", (place == step) & (step < beats))
    bench.always("a row is launched once", entered.frame == (row + active)[: len(row)])
    bench.always("no step without a row", active | (step == 0))
    bench.always("beats are collected as they come", entered.place == beat)
    bench.always("the last beat", last_beat == (beat == beats - 1))
    bench.always("the last step", last_step == (step == beats - 1))
    bench.always("the step after it", following == Mux(last_step, 0, step + 1))
    bench.always("no deadlock: takes beats of a row until it is whole", dut.i.ready | (beat == beats - 1))
    bench.always("no deadlock: takes its last beat unless a row is launched", dut.i.ready | active)
    bench.always("no deadlock: what is in the queue is offered", dut.o.valid | (level == 0))
    waits(bench, active | (credits != 0), Cat(active, valid))
    return bench


def follows(
    bench: FormalBench,
    entered: FrameCounter,
    left: FrameCounter,
    due: list[int],
    total: int,
    under_way: Signal,
) -> None:
    """Assert that outputs leave once each, in their frame, and that the pipeline moves as a whole.

    due : for each place in a frame of inputs, how many of its `total` outputs the beats before allow
    """
    dut = bench.dut
    allowed = Array(Const(outputs, range(total + 1)) for outputs in due)[entered.place]
    place, frame = left.after(under_way)
    whole = allowed == total
    bench.always("each output once", place == Mux(whole, 0, allowed))
    bench.always("each output in its frame", frame == (entered.frame + whole)[:2])
    bench.always(
        "no deadlock: takes a beat when its last stage moves on", dut.i.ready == (dut.o.ready | ~dut.o.valid)
    )


def source(component: type, divergence: str, height: int, width: int, lanes: int) -> FormalBench:
    """A beat leaves for each place of the inner frame, when the slopes that it needs have entered."""
    offset = np.zeros((height - 2, width - 2), int)
    dut = component(PoissonSource(divergence, 1, offset), height=height, width=width, lanes=lanes)
    bench = FormalBench(dut)
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    row_beats, beats, total = width // lanes, dut.beats, (height - 2) * dut.beats
    entered = FrameCounter(bench, "in", enters, height * row_beats)
    left = FrameCounter(bench, "out", leaves, total)

    x, y = bench.probe("x", range(row_beats)), bench.probe("y", range(height))
    flags = complete, late, trailing = [bench.probe(name) for name in ("complete", "late", "trailing")]
    valid = bench.probe("valid", dut.latency - 1)
    bench.always("row and beat of the input", (y * row_beats + x == entered.place) & (x < row_beats))
    bench.always("a row's last output does not meet another", ~late | ~complete)
    bench.always("a row's last output is between rows", ~trailing | (x == 0))

    due = [0]  # outputs of the frame that the beats before each place allow
    for place in range(height * row_beats - 1):
        row, beat = divmod(place, row_beats)
        row -= dut.rows_ahead
        reaches = beat + 1 - dut.beats_ahead if beat < row_beats - 1 else beats
        due.append(min(max(row * beats + max(reaches, 0), due[-1]), total))
    under_way = bench.wire("under_way", ones(valid) + sum(flags))
    follows(bench, entered, left, due, total, under_way)
    waits(bench, under_way != 0, Cat(trailing, complete | late, valid))
    return bench


def windows(component: type, height: int, width: int, lanes: int) -> FormalBench:
    """A beat leaves for each row of cells below the first two and each beat with windows in it."""
    dut = component(DotWindows(np.ones((height // BLOCK, width // BLOCK), int), 1, 1), lanes=lanes)
    bench = FormalBench(dut)
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    line_beats, total = dut.line_beats, dut.windows.shape[0] * dut.row_beats
    entered = FrameCounter(bench, "in", enters, height * line_beats)
    left = FrameCounter(bench, "out", leaves, total)

    x, y = bench.probe("x", range(line_beats)), bench.probe("y", range(height))
    valid = bench.probe("valid", dut.latency)
    bench.always("line and beat of the input", (y * line_beats + x == entered.place) & (x < line_beats))
    due = [0]  # outputs of the frame that the beats before each place complete
    for place in range(height * line_beats - 1):
        line, beat = divmod(place, line_beats)
        last_px = (beat + 1) * lanes - 1
        completes = line % CELL and line >= 2 * CELL and last_px % CELL and last_px >= 3 * CELL - 1
        due.append(due[-1] + bool(completes))
    under_way = bench.wire("under_way", ones(valid))
    follows(bench, entered, left, due, total, under_way)
    waits(bench, under_way != 0, valid)
    return bench


def weighted_sum(component: type) -> FormalBench:
    """A sum leaves for each frame that enters."""
    weight = np.arange(16).reshape(1, 4, 4, 1) % 4
    bench = FormalBench(component(WeightedSum(weight, np.array([1]), 1, False), lanes=2))
    weighted_flow(bench)
    return bench


def weighted_flow(bench: FormalBench) -> tuple[FrameCounter, Signal, Signal]:
    """Assert the flow of a weighted sum of at least 7 beats of two words.

    Returns the counter of the beats that enter, whether a beat reaches the accumulator, and its place.
    """
    dut, m = bench.dut, bench.m
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered = FrameCounter(bench, "in", enters, dut.interval)
    sums = Signal(2)  # frames whose sum has left
    m.d.sync += sums.eq(sums + leaves)

    valid, tree = bench.probe("valid", 5), bench.probe("accumulator.valid", 1)
    beat = bench.probe("accumulator.beat", range(dut.interval))
    done, fresh = bench.probe("accumulator.done"), bench.probe("accumulator.fresh")
    added = Signal(range(2 * dut.interval))  # beats of the frame that is summed, with those under way
    under_way = bench.wire("under_way", ones(valid) + tree)
    m.d.comb += added.eq(beat + under_way)
    ends = added >= dut.interval
    bench.always("no beat lost or made up", entered.place == Mux(ends, added - dut.interval, added))
    bench.always("a sum for each frame", entered.frame == (sums + done + ends)[:2])
    bench.always("a new frame begins with the constant", fresh == (beat == 0))
    bench.always("a sum is offered when its last beat is in it", ~done | (beat == 0))
    bench.always("no deadlock: takes a beat while no sum waits", dut.i.ready | (dut.o.valid & ~dut.o.ready))
    waits(bench, entered.frame != sums, Cat(valid, tree, done), (under_way - entered.place)[:4])
    return entered, tree, beat


PROOFS = (
    *(
        Proof(
            f"sine_transform_{lanes}",
            Dst1Engine,
            f"rows of {size} values of 1 bit, {lanes} a beat: several are under way",
            partial(transform, size=size, lanes=lanes),
            depth=1,
            breaks=(
                ("launch.eq(active & queue.room)", "launch.eq(active)"),
                ("free.eq(~active | (queue.room & last_step))", "free.eq(~active | last_step)"),
                ("last_beat.eq(beat == last - 1)", "last_beat.eq(beat == last)"),
            ),
            broken_depth=24,
        )
        for size, lanes in ((4, 1), (8, 2))
    ),
    *(
        Proof(
            f"source_{divergence}_{lanes}",
            PoissonSourceStream,
            f"{divergence} differences of {height} × {width} slopes of 1 bit, {lanes} a beat",
            partial(source, divergence=divergence, height=height, width=width, lanes=lanes),
            depth=1,
            breaks=(
                ("advance.eq(self.o.ready | ~self.o.valid)", "advance.eq(1)"),
                ("late.eq(trailing)", "late.eq(0)")
                if lanes == 4
                else ("(x < self.beats + self.beats_ahead)", "(x <= self.beats + self.beats_ahead - 2)"),
            ),
            broken_depth=24,
        )
        for divergence, height, width, lanes in (
            ("central", 4, 4, 1),
            ("backward", 4, 4, 2),
            ("central", 4, 8, 4),
        )
    ),
    *(
        Proof(
            f"dot_windows_{lanes}",
            DotWindowStream,
            f"windows of 3 × 3 cells in 8 × 8 values of 1 bit, {lanes} a beat",
            partial(windows, height=8, width=8, lanes=lanes),
            depth=1,
            breaks=(
                ("advance.eq(self.o.ready | ~self.o.valid)", "advance.eq(1)"),
                ("(y >= 2 * CELL * half)", "(y >= 2 * CELL * half - 2)"),
            ),
            broken_depth=64 // lanes + 32,
        )
        for lanes in (2, 4)
    ),
    Proof(
        "weighted_sum",
        WeightedSumStream,
        "frames of 4 × 4 values of 1 bit, two a beat: longer than the pipeline is deep",
        weighted_sum,
        depth=1,
        breaks=(
            ("advance.eq(products.ready | ~products.valid)", "advance.eq(1)"),
            ("self.i.ready.eq(advance)", "self.i.ready.eq(1)"),
        ),
    ),
)
