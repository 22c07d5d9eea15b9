"""A property of frames that leave in another order: every value once, at its place, in its own frame."""

from amaranth import Array, Mux, Signal, Value

from fastac.sim.formal.bench import FormalBench

FRAMES = 4
"""Frames that are told apart; fewer are ever inside."""


class FrameOrder:
    """Assert that the value that enters at `entry` of a frame leaves at `exit` of the same frame, unchanged.

    With places that are free constants the property holds for all values of a frame. Frames are counted
    modulo FRAMES; that fewer than FRAMES are inside is asserted too, so that none is taken for another.

    Parameters
    ----------
    beats : of a frame, the same number at both sides
    entry, value : a beat's place in its frame, and the value of the beat that enters now
    exit, leaving : the place at which the value must leave, and the value of the beat that is offered now

    Attributes
    ----------
    place_in, place_out : place in its frame of the next beat that enters and that leaves
    frame_in, frame_out : the frames of these beats, modulo FRAMES
    caught : value of the tracked place, frame by frame
    held : beats that have entered and not left
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
        exit: Value,
        leaving: Value,
    ):
        self.bench, self.beats = bench, beats
        m = bench.m
        self.place_in, self.place_out = self._place("in", enters), self._place("out", leaves)
        self.frame_in, self.frame_out = self._frame("in", enters), self._frame("out", leaves)
        self.caught = Array(
            Signal(len(value), reset_less=True, name=f"caught_{frame}") for frame in range(FRAMES)
        )
        with m.If(enters & (self.place_in == entry)):
            m.d.sync += self.caught[self.frame_in].eq(value)
        self.whole = (self.frame_in - self.frame_out)[: len(self.frame_in)]
        self.held = bench.wire("held", self.whole * beats + self.place_in - self.place_out)
        bench.always(f"fewer than {FRAMES} frames inside", (self.held >= 0) & (self.held < FRAMES * beats))
        bench.always("places are inside the frame", (self.place_in < beats) & (self.place_out < beats))
        bench.always("no beat before it has entered", ~leaves | (self.held > 0))
        due = bench.dut.o.valid & (self.place_out == exit)
        bench.always(
            "each value once, at its place, unchanged", ~due | (leaving == self.caught[self.frame_out])
        )

    def after(self, place: Value, frame: Value, beats: Value) -> tuple[Value, Value]:
        """Place and frame of the beat that comes `beats` after the one at `place` of `frame`."""
        wraps = place + beats >= self.beats
        return Mux(wraps, place + beats - self.beats, place + beats), (frame + wraps)[: len(frame)]

    def _place(self, side: str, moves: Value) -> Signal:
        place = Signal(range(self.beats), name=f"place_{side}")
        with self.bench.m.If(moves):
            self.bench.m.d.sync += place.eq(Mux(place == self.beats - 1, 0, place + 1))
        return place

    def _frame(self, side: str, moves: Value) -> Signal:
        frame = Signal(range(FRAMES), name=f"frame_{side}")
        place = self.place_in if side == "in" else self.place_out
        with self.bench.m.If(moves & (place == self.beats - 1)):
            self.bench.m.d.sync += frame.eq(frame + 1)
        return frame

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
        waited = Signal(range(patience + 2))
        with bench.m.If(o.valid | ~complete):
            bench.m.d.sync += waited.eq(0)
        with bench.m.Elif(o.ready):
            bench.m.d.sync += waited.eq(waited + 1)
        bench.always(
            f"no deadlock: a beat is offered after {patience} clocks",
            o.valid | ~complete | (waited < patience),
        )
        self.waited = waited
