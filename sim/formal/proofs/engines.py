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
from fastac.gateware.poisson.folded_transform import FoldedDst1
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
    has_word = bench.probe("has_word")
    bench.always("the step after it", following == Mux(has_word & ~last_step, step + 1, 0))
    bench.always("no row before the table is read", has_word | ~active)
    bench.always("no deadlock: takes beats of a row until it is whole", dut.i.ready | (beat == beats - 1))
    bench.always("no deadlock: takes its last beat unless a row is launched", dut.i.ready | active)
    bench.always("no deadlock: what is in the queue is offered", dut.o.valid | (level == 0))
    waits(bench, active | (credits != 0), Cat(active, valid))
    return bench


def folded_transform(component: type, size: int, fold: int) -> FormalBench:
    """Each row that enters leaves as a row; a page is read when it is full, and written when it is read."""
    angles = np.outer(np.arange(1, size + 1), np.arange(1, size + 1))
    matrix = np.rint(2 * np.sin(np.pi * angles / (size + 1))).astype(int)
    bench = FormalBench(component(SineTransform(matrix, 1, 1, 4), fold=fold))
    dut = bench.dut
    enters, _ = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered, left = FrameCounter(bench, "in", enters, size), FrameCounter(bench, "out", leaves, size)

    flags = bench.probe("flags", dut.products + fold + 3)
    depth = len(flags) // fold + 1
    level, _ = fifo_words(bench, "queue.queue.queue", depth, len(Value.cast(dut.o.payload)))
    credits, closed = bench.probe("queue.under_way", range(depth + 1)), bench.probe("queue.full")
    bench.always("a credit for each value under way or in the queue", credits == ones(flags) + level)
    bench.always("no value without a place in the queue", (credits <= depth) & (closed == (credits == depth)))

    # Where the writer is, and whether the last pair of a row is still to be stored.
    pair, back, last = bench.probe("pair", range(dut.half)), bench.probe("back"), bench.probe("last")
    sums, differences = bench.probe("sums"), bench.probe("differences")
    fill_page, place = bench.probe("fill_page"), bench.probe("place", range(2 * fold))
    storing = bench.wire("storing", (sums | differences) & last)
    bench.always("values are collected as they come", entered.place == Mux(back, size - 1 - pair, pair))
    bench.always("pairs of the first half", (pair < dut.half) & (back | (pair < size // 2)))
    bench.always("the page that is filled", fill_page == entered.frame[0])
    bench.always("a sum and then a difference", ~(sums & differences))
    bench.always("the page of a row's last pair", ~storing | (place[-1] != fill_page))
    bench.always(
        "a row's last pair is stored before the next pair", ~storing | ~back | (pair == dut.half - 1)
    )
    inside = bench.wire("inside", back & ((pair != dut.half - 1) | (sums | differences) & ~last))
    bench.always("the page of a pair", storing | ~(sums | differences) | (place[-1] == fill_page))

    # Where the first multiplier is, and whether the last one still reads the row before.
    k, step, read_page = (
        bench.probe("k", range(size + 1)),
        bench.probe("step", range(fold)),
        bench.probe("read_page"),
    )
    following, row = left.after(credits)
    begun = step != 0
    bench.always(
        "each row leaves as it was launched",
        (k - 1) == Mux(begun, Mux(following == 0, size - 1, following - 1), following),
    )
    row = bench.wire("row", (row - (begun & (following == 0)))[:2])
    bench.always("the page that is read", read_page == row[0])
    bench.always(
        "steps follow a launch", Array(Const(1, 1) if s == 0 else flags[s - 1] for s in range(fold))[step]
    )
    reading = Cat(bench.probe(f"ends_{lane}") for lane in range(1, dut.products))
    late = bench.wire("late", reading.any() if dut.products > 1 else Const(0, 1))
    full = bench.probe("full", 2)
    stored = bench.wire("stored", (entered.frame - storing - row)[:2])
    bench.always("at most two rows are stored", stored <= 2)
    bench.always("a stored row fills its page", Mux(read_page, full[1], full[0]) == (stored != 0))
    bench.always("the other page", Mux(read_page, full[0], full[1]) == ((stored == 2) | late))
    bench.always("a page that is still read is not stored again", ~late | (stored < 2))
    bench.always("no step without a row", ~begun | (stored != 0))
    bench.always(
        "no page is written before it is read",
        ~(inside | storing) | ~Mux(fill_page ^ storing, full[1], full[0]),
    )
    if dut.products > 1:
        bench.always("one row at a time is read to its end", ones(reading) <= 1)
        for lane in range(1, dut.products):
            # The next row has begun at most as many clocks ago.
            read = bench.probe(f"read_{lane}", range(4 * fold))
            soon = (k == 1) & (step < lane) & (read[-1] != read_page)
            bench.always(f"multiplier {lane} ends soon after the first", ~reading[lane - 1] | soon)
    bench.always(
        "no deadlock: takes values while a page is free",
        dut.i.ready | sums | (back & Mux(fill_page, full[1], full[0])),
    )
    bench.always("no deadlock: what is in the queue is offered", dut.o.valid | (level == 0))
    waits(bench, (stored != 0) | (credits != 0), Cat(stored != 0, flags))
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
            f"folded_sine_transform_{fold}",
            FoldedDst1,
            f"rows of {size} values of 1 bit, one every {fold} clocks",
            partial(folded_transform, size=size, fold=fold),
            depth=1,
            breaks=(
                ("(step == 0) & queue.room & ", "(step == 0) & "),
                ("self.i.ready.eq(~sums & ", "self.i.ready.eq("),
                ("(~back | ~Mux(page, full[1], full[0]))", "1"),
                ("with m.If(differences & last)", "with m.If(sums & last)"),
                ("m.d.sync += page.eq(~page)", "m.d.sync += page.eq(page)"),
            ),
            broken_depth=30,
        )
        for size, fold in ((6, 2), (5, 4))
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
