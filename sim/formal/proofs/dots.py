"""Proofs of what joins marker dots with the skin: both parts of the force, dark pixels, bridged slopes."""

from functools import partial
from itertools import pairwise

import numpy as np
from amaranth import Array, Cat, Const, Mux, Signal, Value

from fastac.gateware.dots.dark_queue import DarkQueue
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.sim.formal.bench import FormalBench, ones
from fastac.sim.formal.frame_order import FrameCounter
from fastac.sim.formal.in_order import InOrder
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.pipelines import waits
from fastac.sim.formal.proofs.streams import fifo_words

FRAMES = 4 * FRAMES_IN_FLIGHT
"""Frames that are told apart; fewer are ever inside."""
SKIN_WIDTH, EXPONENTS = 2, (0, 1)


def force_sum(component: type) -> FormalBench:
    """Sum k is that of the skin's k-th beat and the dots' k-th; a queue waits for the other part alone.

    A free constant chooses a frame, whose parts are caught as they enter.
    """
    weights = np.ones((len(EXPONENTS), 1, 1, 2), int)
    weighted = WeightedSum(weights, np.zeros(len(EXPONENTS), int), 2, True)
    dut = component(DotForce(weighted, np.array(EXPONENTS)), skin_width=SKIN_WIDTH, width=5)
    bench = FormalBench(dut)
    m = bench.m
    chosen = bench.constant("chosen", range(FRAMES))
    leaves = bench.sink(dut.o, "o")
    left = Signal(range(FRAMES))
    m.d.sync += left.eq(left + leaves)
    nexts = (left + dut.o.valid)[: len(left)]  # the frame that leaves the queues next

    caught, levels = {}, {}
    for name in ("skin", "dots"):
        port = getattr(dut, name)
        enters, payload = bench.source(port, name)
        entered = Signal(range(FRAMES), name=f"{name}_entered")
        caught[name] = Signal(port.payload.shape(), name=f"{name}_caught", reset_less=True)
        m.d.sync += entered.eq(entered + enters)
        with m.If(enters & (entered == chosen)):
            m.d.sync += Value.cast(caught[name]).eq(payload)
        level, words = fifo_words(bench, f"{name}_queue", FRAMES_IN_FLIGHT, len(payload), f"{name}: the FIFO")
        levels[name] = level
        bench.always(f"{name}: nothing lost or made up", (entered - nexts)[: len(left)] == level)
        bench.always(
            f"{name}: takes a beat while its queue has room", port.ready == (level != FRAMES_IN_FLIGHT)
        )
        for k, word in enumerate(words):
            held = (level > k) & ((nexts + k)[: len(left)] == chosen)
            bench.always(f"{name}: beat {k} is stored", ~held | (word == Value.cast(caught[name])))

    offered = dut.o.valid & (left == chosen)
    for axis, exponent in enumerate(EXPONENTS):
        total = caught["skin"][axis] + (caught["dots"][axis] << exponent)
        bench.always(f"axis {axis}: the frame's own sum", ~offered | (dut.o.payload[axis] == total))
    both = (levels["skin"] != 0) & (levels["dots"] != 0) & (dut.o.ready | ~dut.o.valid)
    bench.always(
        "no deadlock: offered a clock after both parts are there", ~bench.past(both, "both") | dut.o.valid
    )
    return bench


def dark_queue(component: type, depth: int, lanes: int) -> FormalBench:
    """Beats leave as they entered, each pixel as whether its darkness is above 0."""
    dut = component(DotWindows(np.full((2, 2), 3), 1, 1), lanes=lanes, depth=depth)
    bench = FormalBench(dut)
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    bits = len(payload) // lanes
    dark = Cat(payload.word_select(k, bits).any() for k in range(lanes))
    track = InOrder(bench, enters, dark, leaves, dut.o.payload, capacity=depth)
    level, words = fifo_words(bench, "queue", depth, lanes)
    track.stored(bench, words)
    bench.always("inside are the FIFO's beats", track.inside == level)
    bench.always("no deadlock: what is inside is offered", dut.o.valid == (track.inside != 0))
    bench.always("no deadlock: takes a beat while it has room", dut.i.ready == (track.inside != depth))
    return bench


def slope_bridge(component: type, lanes: int, reach: int) -> FormalBench:
    """Each beat leaves once, in order, with the slopes that its row's dark pixels call for.

    The bench keeps the beats as they enter, the latest first, without the voids between rows, and finds
    there what a pixel takes: from the nearest one of its row that is not dark, of two the left one.
    """
    dut = component(SlopeBridge(DotWindows(np.ones((2, 2), int), 1, 1), reach), slope_bits=1, lanes=lanes)
    bench = FormalBench(dut)
    row, ahead, layout = dut.row_beats, dut.ahead, dut.i.payload.shape()
    enters, payload = bench.source(dut.i, "i")
    leaves = bench.sink(dut.o, "o")
    entered, left = FrameCounter(bench, "in", enters, row), FrameCounter(bench, "out", leaves, row)
    entries = [Signal(layout, name=f"entry_{k}", reset_less=True) for k in range(2 * ahead + 2)]
    with bench.m.If(enters):
        bench.m.d.sync += Value.cast(entries[0]).eq(payload)
        bench.m.d.sync += [Value.cast(old).eq(Value.cast(new)) for new, old in pairwise(entries)]

    here = bench.probe("here", ahead + 1)
    middle = bench.probe("column", range(row))
    window = [bench.probe(f"beat_{k}", layout.size) for k in range(2 * ahead + 1)]
    inside = Signal(range(ahead + 4))
    bench.m.d.sync += inside.eq(inside + enters - leaves)
    bench.always("no beat lost or made up", inside == ones(here) + dut.o.valid)
    place, frame = left.after(inside)
    bench.always("beats of a row leave in its order", (place == entered.place) & (frame == entered.frame))
    bench.always("the row's beats that have entered", bench.probe("entering", range(row)) == entered.place)
    bench.always("the column of the window's middle", middle == (left.place + dut.o.valid) % row)

    # For the induction: between beats of a row the window has no void, and it has the beats that entered.
    words = [Value.cast(entry) for entry in entries]
    history = Array(words)
    follows = Const(1)  # the beat before is there, or it is of another row
    column: Value = middle
    bench.always("a row that has begun goes on in the middle", (middle == 0) | here[0])
    for k in range(ahead + 1):
        newer = ones(here[k + 1 :])
        bench.always(f"beat {k} ahead is as it entered", ~here[k] | (window[ahead + k] == history[newer]))
        bench.always(f"beat {k} ahead follows the one before", ~here[k] | follows | (column == 0))
        following = bench.wire(f"following_{k}", (column + here[k]) % row)
        follows, column = here[k], following
    bench.always("a row that is not whole has no void behind it", (entered.place == 0) | here[ahead])
    for k in range(1, ahead + 1):
        before = history[ones(here) - 1 + k]
        bench.always(f"beat {k} behind is as it entered", (middle < k) | (window[ahead - k] == before))

    newest = ones(here)  # beats that have entered after the one at the output
    here_rest = Mux(row - 1 - left.place < ahead, row - 1 - left.place, ahead)
    bench.always("leaves after all beats that it may take from", ~dut.o.valid | (newest >= here_rest))

    def beat(offset: int):
        """The beat so many after the one at the output."""
        index = Mux(newest >= offset, newest - offset, 0) if offset > 0 else newest - offset
        value = Signal(layout, name=f"beat_{'after' if offset > 0 else 'before'}_{abs(offset)}")
        bench.m.d.comb += Value.cast(value).eq(history[index])
        return value

    beats = {offset: beat(offset) for offset in range(-ahead, ahead + 1)}
    for lane in range(lanes):
        own = beats[0]
        takes, open_ = [], own.dark[lane]
        for distance in range(1, reach + 1):
            for step in (-distance, distance):
                offset, other = divmod(lane + step, lanes)
                where = left.place + offset
                skin = (where >= 0) & (where < row) & ~beats[offset].dark[other]
                takes.append((open_ & skin, beats[offset], other))
                open_ = open_ & ~skin
        slopes, over = Value.cast(own.slopes[lane]), own.over[lane]
        for taken, source, other in takes:  # at most one is taken
            slopes = Mux(taken, Value.cast(source.slopes[other]), slopes)
            over = Mux(taken, source.over[other], over)
        o = dut.o.payload
        bench.always(f"lane {lane}: its slopes", ~dut.o.valid | (Value.cast(o.slopes[lane]) == slopes))
        bench.always(f"lane {lane}: whether they saturated", ~dut.o.valid | (o.over[lane] == over))

    bench.always(
        "no deadlock: takes a beat when its last one moves on", dut.i.ready == (dut.o.ready | ~dut.o.valid)
    )
    # A whole row leaves without a further beat.
    waits(bench, (entered.place == 0) & (inside != 0), Cat(here[::-1], dut.o.valid))
    return bench


PROOFS = (
    Proof(
        "force_sum",
        ForceSum,
        "two axes, skin of 2 and dots of 3 bits, exponents 0 and 1; axes are alike",
        force_sum,
        depth=2,
        breaks=(
            ("skin_here & dots_here &", "skin_here &"),
            ("& (self.o.ready | ~self.o.valid)", ""),
            ("source.ready.eq(queue.w_rdy)", "source.ready.eq(1)"),
            ("shift_left(exponent)", "shift_left(0)"),
        ),
    ),
    Proof(
        "dark_queue",
        DarkQueue,
        "depth 3, two pixels of 2 bits; pixels are alike",
        partial(dark_queue, depth=3, lanes=2),
        depth=2,
        breaks=(
            ("value != 0", "value[0]"),
            ("queue.w_en.eq(self.i.valid)", "queue.w_en.eq(1)"),
            ("self.i.ready.eq(queue.w_rdy)", "self.i.ready.eq(1)"),
            ("queue.r_en.eq(self.o.ready)", "queue.r_en.eq(1)"),
        ),
        quick=True,
    ),
    *(
        Proof(
            f"slope_bridge_{lanes}_{reach}",
            SlopeBridgeStream,
            f"rows of {8 // lanes} beats of {lanes} pixels, reach {reach}, slopes of 1 bit: only moved",
            partial(slope_bridge, lanes=lanes, reach=reach),
            depth=2,
            breaks=(
                ("(entering == 0) & here[0]", "here[0]"),
                ("(self.i.valid | ((entering == 0) & here[0] & due))", "self.i.valid"),
                ("column >= -beat", "1"),
                ("for step in (distance, -distance)", "for step in (-distance, distance)"),
            ),
        )
        for lanes, reach in ((1, 2), (2, 1), (2, 3))
    ),
)
