"""Proof of the frame guard: every frame that leaves is whole, whatever comes in, and a good one is exact."""

from functools import partial

from amaranth import Mux, Signal

from fastac.gateware.stream.frame_guard import FrameGuard, State
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

LONGEST_TIMEOUT = 2


def frame_guard(component: type, height: int, width: int) -> FormalBench:
    """Nothing is assumed of the input, not even that a beat stays offered; `hold` and resets are free."""
    beats = height * width
    bench = FormalBench(component(height, width, 1, lanes=1))
    m, dut, axis = bench.m, bench.dut, bench.dut.axis
    enable, hold = bench.free("enable"), bench.free("hold")
    data, last, start = bench.free("data", 8), bench.free("last"), bench.free("start")
    timeout = bench.free("timeout", 32)
    bench.assume(timeout <= LONGEST_TIMEOUT)
    for port, value in (
        *((dut.enable, enable), (dut.hold, hold), (dut.timeout, timeout)),
        *((axis.tdata, data), (axis.tlast, last), (axis.tuser, start)),
    ):
        bench.drive(port, value)
    left = bench.sink(dut.o, "o")
    tagged = bench.sink(dut.tag, "tag")

    # Position of the beat at `o` in its frame, counted from the transfers alone.
    place = Signal(range(beats))
    closes = bench.wire("closes", place == beats - 1)
    with m.If(left):
        m.d.sync += place.eq(Mux(closes, 0, place + 1))
    x, y = bench.probe("x", range(width)), bench.probe("y", range(height))
    entering = bench.wire("entering", Mux(dut.o.valid, Mux(closes, 0, place + 1), place))
    bench.always("frames are whole: the guard's position is that of the beats", y * width + x == entering)
    bench.always("the position is inside the frame", (x < width) & (y < height) & (place < beats))
    bench.always("the register knows the frame's last beat", ~dut.o.valid | (bench.probe("closes") == closes))

    # A tag for each frame, in the clock after its last beat.
    due = bench.past(left & closes, "tag_due")
    waits = bench.past(dut.tag.valid & ~tagged, "tag_waits_too")
    bench.always("a tag for each frame, right after its last beat", dut.tag.valid == (due | waits))
    bench.always("no tag is overwritten", ~(dut.o.valid & closes & dut.tag.valid))

    # The last accepted beat waits in the guard, or has gone on; what it was.
    accepted_start = Signal()
    accepted_last = Signal()
    accepted_enable = Signal()
    accepted_data = Signal(8)
    accepted = bench.wire("accepts", axis.tvalid & axis.tready)
    with m.If(accepted):
        m.d.sync += [
            *(accepted_start.eq(start), accepted_last.eq(last)),
            *(accepted_enable.eq(enable), accepted_data.eq(data)),
        ]
    held = bench.probe("held")
    for name, copy in (("start", accepted_start), ("last", accepted_last), ("wanted", accepted_enable)):
        bench.always(f"the waiting beat's {name}", ~held | (bench.probe(name) == copy))
    bench.always("the waiting beat's pixels", ~held | (bench.probe("pixels", 8) == accepted_data))
    bench.always("`accepted` tells of each accepted beat", dut.accepted == accepted)

    # Frames begin with a wanted start of frame, end once, and are bad if a fault was reported in them.
    begins = bench.wire("begins", dut.frame_started)
    ends = bench.wire("ends", dut.frame_done)
    inside = Signal()  # of the frame that enters the output register
    m.d.sync += inside.eq((inside | begins) & ~ends)
    bench.always("inside a frame: not at its first beat", inside == (entering != 0))
    bench.always(
        "a frame begins with a start of frame while enabled", ~begins | (accepted_start & accepted_enable)
    )
    bench.always("no frame begins inside a frame, nor while held", ~begins | (~inside & ~hold & held))
    bench.always("a frame ends after it has begun", ~ends | inside)
    fault = bench.wire("fault", dut.line_short | dut.line_long | dut.frame_short | dut.frame_timeout)
    faulty = Signal()
    m.d.sync += faulty.eq((faulty | fault) & ~ends)
    bench.always("faults belong to frames", ~fault | inside | begins)
    bench.always("a faulty frame is bad, others are not", ~ends | (dut.frame_bad == (faulty | fault)))
    bench.always("faults do not outlive their frame", inside | ~faulty)
    bench.always("the guard remembers a fault", bench.probe("bad") == faulty)
    tag = Signal()  # of the frame whose last beat is in the output register
    with m.If(ends):
        m.d.sync += tag.eq(dut.frame_bad)
    bench.always("the register keeps the tag", ~(dut.o.valid & closes) | (bench.probe("closes_bad") == tag))
    after = bench.past(tag, "tag_after")
    bench.always("the tag is the frame's", ~due | (dut.tag.payload == after))

    # While no fault is reported, the guard is inside a line, and forwards what the camera sent.
    good = bench.wire("good", ~faulty & ~fault)
    state = bench.probe("state", 3)
    bench.always("the guard's state is one of five", state <= State.FILL.value)
    between = (state == State.WAIT.value) | ((state == State.DROP.value) & (y == 0))
    bench.always("the state says whether a frame is unfinished", between == ~inside)
    bench.always("a good frame is inside a line", ~(inside & good) | (state == State.LINE.value))
    begins_line = (state == State.DROP.value) & (x != 0)
    bench.always("surplus beats are dropped between lines", ~begins_line)
    chosen = bench.constant("chosen", range(beats))
    none = beats + 1
    index = Signal(
        range(none + 1), init=none
    )  # of the next accepted beat behind the last wanted start of frame
    now = bench.wire("now", Mux(start, Mux(enable, 0, none), index))
    caught = Signal(8)
    line_end = Signal()
    with m.If(accepted):
        m.d.sync += index.eq(Mux(now >= beats, none, now + 1))
        with m.If(now == chosen):
            m.d.sync += [caught.eq(data), line_end.eq(last)]
    forwards = inside & good
    bench.always("as many beats as accepted", ~forwards | (index == entering + held))
    wanted_start = held & accepted_start & accepted_enable
    bench.always("behind a wanted start of frame comes beat 1", ~wanted_start | (index == 1))
    complete = dut.o.valid & closes & ~tag
    bench.always("a good frame is complete", ~complete | (index >= beats) | wanted_start)
    waits_chosen = held & (index == chosen + 1)
    bench.always("the chosen beat waits unchanged", ~waits_chosen | (accepted_data == caught))
    bench.always("the chosen beat waits with its `tlast`", ~waits_chosen | (accepted_last == line_end))
    offered = dut.o.valid & (place == chosen) & ~Mux(closes, tag, ~good)
    bench.always("a good frame has the camera's pixels", ~offered | (dut.o.payload.as_value() == caught))
    ends_line = chosen % width == width - 1
    bench.always("a good frame's lines had their ends", ~offered | (line_end == ends_line))

    # No deadlock: the input is taken, and a frame that the camera leaves unfinished is completed.
    free = bench.wire("free", dut.o.ready & dut.tag.ready & ~hold)
    blocked = Signal(range(beats + 4))
    m.d.sync += blocked.eq(Mux(free & ~axis.tready, blocked + 1, 0))
    bench.always("no deadlock: a beat is taken after a padding at most", blocked <= beats + 2)
    patience = LONGEST_TIMEOUT + beats + 3
    silent = Signal(range(patience + 2))
    m.d.sync += silent.eq(Mux(free & ~axis.tvalid & (timeout != 0) & (entering != 0), silent + 1, 0))
    bench.always("no deadlock: an abandoned frame is completed", silent <= patience)
    return bench


BREAKS = (
    ("& ~(frame_ends & self.tag.valid & ~self.tag.ready)", ""),
    ("with m.If(start & wanted):", "with m.If(start):"),
    ("self.line_short.eq(received & last & ~line_ends)", "self.line_short.eq(0)"),
    ("self.line_long.eq(received & ~last & line_ends)", "self.line_long.eq(0)"),
    ("m.d.comb += self.frame_short.eq(held)", "m.d.comb += self.frame_short.eq(0)"),
    ("send.eq(held & room & ~self.hold)", "send.eq(held & room)"),
    ("with m.If(self.frame_short | self.frame_timeout):", "with m.If(self.frame_short):"),
    ("self.o.payload[self.lanes - 1], pixels[lane]", "self.o.payload[self.lanes - 1], 1"),
)
PROOFS = tuple(
    Proof(
        f"frame_guard_{height}x{width}",
        FrameGuard,
        f"{height} lines of {width} beats, one channel, timeouts of 0 to {LONGEST_TIMEOUT} clocks. The guard"
        " compares its position with the last of line and frame only, and the clocks waited with the timeout",
        partial(frame_guard, height=height, width=width),
        depth=height * width + LONGEST_TIMEOUT + 5,
        breaks=breaks,
        quick=quick,
    )
    for height, width, breaks, quick in ((2, 2, BREAKS, True), (3, 3, (), False))
)
