"""Proof of the frame's flags as a stream: one verdict for each frame, in order, kept until it is taken."""

from amaranth import Cat, Mux, Signal

from fastac.gateware.arithmetic.frame_sum import tree_levels
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.gateware.stream.frame_validity import FrameValidity
from fastac.models.integer import frame_validity as model
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.streams import fifo_words

HEIGHT, WIDTH, CHANNELS = 2, 2, 3
BEATS = HEIGHT * WIDTH


def frame_validity(component: type) -> FormalBench:
    """The stages' beats come at any time; at most FRAMES_IN_FLIGHT verdicts wait, as the datapath sees to."""
    validity = model.FrameValidity.unlimited((HEIGHT, WIDTH, CHANNELS), slopes=False, displacements=False)
    bench = FormalBench(component(validity, lanes=1))
    m, dut = bench.m, bench.dut
    taken = bench.free("features_taken")
    bench.drive(dut.features_taken, taken)
    leaves = bench.sink(dut.verdict, "verdict")
    level, _ = fifo_words(bench, "verdicts", FRAMES_IN_FLIGHT, len(model.REASONS))

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
    return bench


PROOFS = (
    Proof(
        "frame_validity",
        FrameValidity,
        f"{HEIGHT} × {WIDTH} pixels of {CHANNELS} channels, no slopes: other measures only add to the flags",
        frame_validity,
        depth=2,
        breaks=(
            ("verdicts.r_en.eq(self.verdict.ready)", "verdicts.r_en.eq(1)"),
            ("self.verdict.valid.eq(verdicts.r_rdy)", "self.verdict.valid.eq(1)"),
        ),
        broken_depth=24,
    ),
)
