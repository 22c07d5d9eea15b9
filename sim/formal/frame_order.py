"""A property of frames that leave in another order: every value once, at its place, in its own frame."""

from amaranth import Array, Mux, Signal, Value

from fastac.sim.formal.bench import FormalBench

FRAMES = 4
"""Frames that are told apart; fewer are ever inside."""


class FrameCounter:
    """Place in its frame, and frame modulo FRAMES, of the next beat of a stream.

    moves : a beat moves in this clock
    beats : of a frame
    """

    def __init__(self, bench: FormalBench, side: str, moves: Value, beats: int):
        self.beats = beats
        self.place, self.frame = Signal(range(beats), name=f"place_{side}"), Signal(2, name=f"frame_{side}")
        last = self.place == beats - 1
        with bench.m.If(moves):
            bench.m.d.sync += [self.place.eq(Mux(last, 0, self.place + 1)), self.frame.eq(self.frame + last)]
        bench.always(f"place_{side} is inside the frame", self.place < beats)

    def after(self, beats: Value) -> tuple[Value, Value]:
        """Place and frame of the beat that comes `beats` after the next one."""
        place = self.place + beats
        return place % self.beats, (self.frame + place // self.beats)[:2]


class FrameOrder:
    """Follow the value that enters at `entry` of each frame, and assert what leaves in its place.

    If `entry` is a free constant, what is asserted holds for all values of a frame. Frames are counted
    modulo FRAMES; that fewer than FRAMES are inside is asserted too, so that none is taken for another.

    Parameters
    ----------
    beats : of a frame, the same number at both sides
    entry, value : a beat's place in its frame, and the value of the beat that enters now

    Attributes
    ----------
    place_in, place_out : place in its frame of the next beat that enters and that leaves
    frame_in, frame_out : the frames of these beats, modulo FRAMES
    caught : value of the tracked place, frame by frame
    held : beats that have entered and not left
    left : counter of the beats that leave
    """

    def __init__(
        self,
        bench: FormalBench,
        enters: Value,
        leaves: Value,
        *,
        beats: int,
        entry: Value,
        value: Value,
    ):
        self.bench, self.beats = bench, beats
        m = bench.m
        self.left = FrameCounter(bench, "out", leaves, beats)
        entered = FrameCounter(bench, "in", enters, beats)
        self.place_in, self.place_out = entered.place, self.left.place
        self.frame_in, self.frame_out = entered.frame, self.left.frame
        self.caught = Array(
            Signal(len(value), reset_less=True, name=f"caught_{frame}") for frame in range(FRAMES)
        )
        with m.If(enters & (self.place_in == entry)):
            m.d.sync += self.caught[self.frame_in].eq(value)
        self.whole = (self.frame_in - self.frame_out)[: len(self.frame_in)]
        self.held = bench.wire("held", self.whole * beats + self.place_in - self.place_out)
        bench.always(f"fewer than {FRAMES} frames inside", (self.held >= 0) & (self.held < FRAMES * beats))
        bench.always("no beat before it has entered", ~leaves | (self.held > 0))

    def expect(self, exit: Value, leaving: Value) -> None:
        """Assert that the value leaves at place `exit`, where it is `leaving` of the beat that is offered."""
        due = self.bench.dut.o.valid & (self.place_out == exit)
        known = self.caught[self.frame_out]
        self.bench.always("each value once, at its place, unchanged", ~due | (leaving == known))

    def progress(self, capacity: int, complete: Value, patience: int) -> None:
        """Assert that nothing waits for ever if the reader is fair.

        capacity : beats inside without which the input is ready
        complete : enough beats are inside for one to leave
        patience : clocks with the output ready after which one is offered
        """
        bench, o = self.bench, self.bench.dut.o
        bench.always(
            f"no deadlock: the input is ready with fewer than {capacity} beats inside",
            bench.dut.i.ready | (self.held >= capacity),
        )
        waited = bench.waited(complete, patience)
        bench.always(
            f"no deadlock: a beat is offered after {patience} clocks",
            o.valid | ~complete | (waited < patience),
        )
        self.waited = waited
