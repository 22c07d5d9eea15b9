"""Proofs of the frame's flags as a stream: one verdict for each frame, in order, kept until it is taken."""

from dataclasses import replace
from functools import partial

import numpy as np
from amaranth import Cat, Mux, Signal, Value

from fastac.gateware.arithmetic.frame_sum import tree_levels
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.gateware.stream.frame_validity import DOTS_LATENCY, FrameValidity
from fastac.models.integer import frame_validity as model
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.in_order import InOrder
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.streams import fifo_words

HEIGHT, WIDTH, CHANNELS = 2, 2, 3
BEATS = HEIGHT * WIDTH
DOTS, LOST = 3, 1
"""Marker dots, and how many of them may be lost."""
DOTS_BIT = model.REASONS.index("dots")


def frame_validity(component: type, dots: int = 0) -> FormalBench:
    """The stages' beats come at any time; at most FRAMES_IN_FLIGHT verdicts wait, as the datapath sees to."""
    validity = model.FrameValidity.unlimited(
        (HEIGHT, WIDTH, CHANNELS), slopes=False, displacements=False, dots=dots
    )
    if dots:
        high = np.where([name == "dots" for name in validity.names], LOST, validity.high)
        validity = replace(validity, high=high)
    bench = FormalBench(component(validity, lanes=1))
    m, dut = bench.m, bench.dut
    taken = bench.free("features_taken")
    bench.drive(dut.features_taken, taken)
    leaves = bench.sink(dut.verdict, "verdict")
    level, words = fifo_words(bench, "verdicts", FRAMES_IN_FLIGHT, len(model.REASONS))

    # Frames whose last features have passed, and their verdicts.
    place = Signal(range(BEATS))
    ends = bench.wire("ends", taken & (place == BEATS - 1))
    with m.If(taken):
        m.d.sync += place.eq(Mux(ends, 0, place + 1))
    due = Signal(range(2 * FRAMES_IN_FLIGHT))  # frames that have ended and whose verdict was not taken
    m.d.sync += due.eq(due + ends - leaves)
    bench.assume((due < FRAMES_IN_FLIGHT) | ~ends)
    bench.always("as many frames as may be in flight", due <= FRAMES_IN_FLIGHT)
    bench.always("no verdict without a frame", ~leaves | (due != 0))
    # Register, adder tree, sum and comparison: where the last beats of frames, and all beats, are.
    steps, levels = dut.latency - 1, tree_levels(CHANNELS)
    under_way, moving = Signal(steps), Signal(1 + levels)
    m.d.sync += [under_way.eq(under_way << 1 | ends), moving.eq(moving << 1 | taken)]
    bench.always("one verdict for each frame", due == level + ones(under_way))
    inner = Cat(bench.probe("change_held"), bench.probe("change_count.valid", levels))
    bench.always("beats on their way to the sum", inner == moving)
    counted = bench.wire("counted", (place + BEATS - ones(moving)) % BEATS)
    bench.always("beats in the sum", bench.probe("change_count.beat", range(BEATS)) == counted)
    for k in range(1 + levels):
        index = (place + 2 * BEATS - 1 - ones(moving[:k])) % BEATS
        bench.always(f"step {k}: last beats of frames", under_way[k] == (moving[k] & (index == BEATS - 1)))
    bench.always("sums that are complete", under_way[steps - 2] == bench.probe("change_count.done"))
    bench.always("flags that are known", under_way[steps - 1] == bench.probe("change_done"))
    if dots:
        verdicts = level
        for k, word in enumerate(words):
            bench.always(f"verdict {k} has no flag of dots yet", (level <= k) | ~(word >> DOTS_BIT).any())
        level = of_dots(bench, dots, leaves)
        known = (verdicts != 0) & (level != 0)
        bench.always("no deadlock: offered when both are known", dut.verdict.valid == known)
    else:
        bench.always("no deadlock: offered when it is known", dut.verdict.valid == (level != 0))
    return bench


def of_dots(bench: FormalBench, dots: int, leaves: Value) -> Value:
    """Dots come at any time; each verdict has its frame's flag of them, in order. Returns how many wait."""
    m, dut = bench.m, bench.dut
    taken, lost = bench.free("dot_taken"), bench.free("dot_lost")
    bench.drive(dut.dot_taken, taken)
    bench.drive(dut.dot_lost, lost)
    place, before = Signal(range(dots), name="dot"), Signal(range(dots + 1), name="lost_before")
    ends = bench.wire("dots_end", taken & (place == dots - 1))
    count = bench.wire("lost_so_far", before + lost)
    with m.If(taken):
        m.d.sync += place.eq(Mux(ends, 0, place + 1))
        m.d.sync += before.eq(Mux(ends, 0, count))
    # Register, sum and comparison, a clock each, then the FIFO.
    steps = DOTS_LATENCY - 1
    moving, ending = [taken], [ends]
    counts = [count]
    for k in range(steps):
        moving.append(bench.past(moving[-1], f"dot_step_{k}"))
        ending.append(bench.past(ending[-1], f"dots_end_step_{k}"))
        later = Signal.like(count, name=f"lost_step_{k}", reset_less=True)
        m.d.sync += later.eq(counts[-1])
        counts.append(later)
    flag = counts[steps] > LOST
    level, words = fifo_words(bench, "dot_flags", FRAMES_IN_FLIGHT, 1, "the dots' FIFO")
    offered = dut.verdict.payload[DOTS_BIT]
    due = Signal(range(2 * FRAMES_IN_FLIGHT), name="dots_due")
    m.d.sync += due.eq(due + ends - leaves)
    bench.assume((due < FRAMES_IN_FLIGHT) | ~ends)
    bench.always("dots: as many frames as may be in flight", due <= FRAMES_IN_FLIGHT)
    bench.always("dots: one flag for each frame", due == level + ones(Cat(ending[1:])))
    track = InOrder(bench, ending[steps], flag, leaves, offered, capacity=FRAMES_IN_FLIGHT)
    track.stored(bench, words)
    bench.always("dots: the queue has the frames whose flag is known", track.inside == level)

    # For the induction: the count as it goes through the steps.
    value, fresh = bench.probe("dots_value_0", 2), bench.probe("dots_count.fresh")
    total = bench.probe("dots_count.accumulator_0", 1 + dots.bit_length())
    place_1, before_1 = bench.past(place, "dot_step"), bench.past(before, "lost_before_step")
    beat = bench.probe("dots_count.beat", range(dots))
    bench.always("dots: the next one is of the frame", place < dots)
    bench.always("dots: no more are lost than there were", (before <= place) & (before_1 <= place_1))
    bench.always("dots: the last one ends the frame", ending[1] == (moving[1] & (place_1 == dots - 1)))
    follows = (before == Mux(ending[1], 0, counts[1])) & (place == Mux(ending[1], 0, place_1 + 1))
    bench.always("dots: one follows the other", ~moving[1] | follows)
    bench.always("dots: whether one is at the sum", bench.probe("dots_held") == moving[1])
    bench.always("dots: its bit", ~moving[1] | (counts[1] == before_1 + value))
    bench.always("dots: those in the sum", beat == Mux(moving[1], place_1, place))
    bench.always("dots: a frame begins with its first", fresh == (beat == 0))
    bench.always("dots: the sum so far", Mux(fresh, 0, total) == Mux(moving[1], before_1, before))
    bench.always("dots: when a sum is complete", bench.probe("dots_count.done") == ending[2])
    bench.always("dots: the complete sum", ~ending[2] | (total == counts[2]))
    bench.always("dots: when a flag is known", bench.probe("dots_done") == ending[3])
    bench.always("dots: the flag", ~ending[3] | (bench.probe("dots") == flag))
    return level


PROOFS = (
    Proof(
        "frame_validity",
        FrameValidity,
        f"{HEIGHT} × {WIDTH} pixels of {CHANNELS} channels, no slopes: other measures only add to the flags",
        frame_validity,
        depth=2,
        breaks=(
            ("verdicts.r_en.eq(taken)", "verdicts.r_en.eq(1)"),
            ("self.verdict.valid.eq(ready)", "self.verdict.valid.eq(1)"),
        ),
        broken_depth=24,
    ),
    Proof(
        "frame_validity_dots",
        FrameValidity,
        f"the same with {DOTS} dots, of which {LOST} may be lost, at any time before or after the pixels",
        partial(frame_validity, dots=DOTS),
        depth=2,
        breaks=(
            ("ready & of_dots.r_rdy", "ready"),
            ("of_dots.r_en.eq(taken)", "of_dots.r_en.eq(self.verdict.ready)"),
            ("of_dots.w_data.eq(beyond)", "of_dots.w_data.eq(0)"),
            ("[self.dot_lost], 1, self.validity.dots)", "[self.dot_lost], 1, self.validity.dots + 1)"),
        ),
        broken_depth=24,
    ),
)
