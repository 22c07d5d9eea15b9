"""A fault as beats and events beside them, and how lines, frames and ways into a state are written."""

import random
from dataclasses import asdict, dataclass, field

from fastac.sim.faults.kinds import KINDS

MILD, STRONG = 8, 3
"""Images of the bank: the first ones are ordinary, the others saturate."""


@dataclass(frozen=True)
class Shape:
    """What the generator must know of the hardware."""

    height: int
    line_beats: int
    streams: int
    loadable: bool

    @property
    def beats(self) -> int:
        return self.height * self.line_beats


@dataclass
class Fault:
    """One fault: what is sent, what happens besides, and the good frame after it.

    beats : [image of the bank, row, beat of the line, end of line, start of frame, clocks of pause before it]
    events : dicts, one after the other: `at` beats accepted, and the guard in `state` (None: any), `delay`
        clocks later, do `do` with `settings`. While one with `hold` waits, no further beat is offered.
    kinds : one or two names of KINDS; states : the state in which each is to begin, or None
    marks : {beat: place in `kinds`}, for kinds that begin with a beat
    slow_outputs : probability per clock that an output is not ready
    serves : the host reads each result when the interrupt comes
    """

    number: int
    kinds: list[str]
    states: list[str | None]
    beats: list[list[int]] = field(default_factory=list)
    events: list[dict] = field(default_factory=list)
    marks: dict[int, int] = field(default_factory=dict)
    slow_outputs: float = 0.0
    serves: bool = True

    def as_dict(self) -> dict:
        return asdict(self)


class Script:
    """Beats and events of a fault, to which lines, frames and the way into a state of the guard are added.

    row : of the camera's frame under way, the next one; None between frames
    begun : beats of the line under way that have been sent
    """

    def __init__(self, shape: Shape, rng: random.Random, fault: Fault):
        self.shape, self.rng, self.fault = shape, rng, fault
        self.row: int | None = None
        self.image, self.begun = rng.randrange(MILD), 0
        self.pauses = rng.choice([0, 0, 0, 0.1, 0.4])

    def pause(self) -> int:
        """Clocks before the next beat."""
        return self.rng.choice([1, 1, 2, 3, 10]) if self.rng.random() < self.pauses else 0

    # Beats

    def line(
        self, length: int | None = None, *, last: int = 1, start: int = 0, row: int | None = None
    ) -> None:
        whole = self.shape.line_beats
        length = whole if length is None else length
        row = self.row if row is None else row
        for k in range(length):
            ends = last * (k == length - 1)
            place = [self.image, row % self.shape.height, k % whole]
            self.fault.beats.append([*place, ends, start * (k == 0), self.pause()])

    def lines(self, count: int) -> None:
        """Whole lines, the first of which starts a frame unless one is under way."""
        for _ in range(count):
            starts = self.row is None
            if starts:
                self.row, self.image = 0, self.rng.randrange(MILD)
            self.line(start=int(starts))
            self.step()

    def step(self) -> None:
        self.row = None if self.row is None or self.row + 1 >= self.shape.height else self.row + 1

    def whole_frame(self) -> None:
        self.row = None
        self.lines(self.shape.height)

    def good_frame(self) -> None:
        """Waits until what was to happen before it has happened."""
        self.event("join", hold=True)
        self.whole_frame()

    def event(self, do: str, *, state: str | None = None, delay: int = 0, hold: bool = False, **settings):
        at = len(self.fault.beats)
        self.fault.events.append(
            {"at": at, "state": state, "delay": delay, "hold": hold, "do": do, "settings": settings}
        )

    # The way into a state of the guard

    def lead_in(self, kind: str, state: str) -> None:
        rng, height, whole = self.rng, self.shape.height, self.shape.line_beats
        by_beats = KINDS[kind].beats
        idle = kind in ("calibration_loaded", "calibration_restarted", "calibration_reset")
        if state == "WAIT":
            return
        if state == "LINE":
            self.lines(rng.randint(1, height - 2))
            if not by_beats:
                self.part_of_a_line(rng.randint(1, whole - 1))
        elif state == "DROP":
            self.lines(height - 1 if idle else rng.randint(1, height - 1))
            # The next beat comes while the last surplus beat is looked at.
            self.line(whole + rng.randint(2, 4), last=int(by_beats))
            self.fault.beats[-1][-1] = self.fault.beats[-2][-1] = 0
            self.step()
        elif state == "PAD":
            self.lines(rng.randint(1, height - 2))
            self.line(1)
            self.step()
        else:
            self.lines(rng.randint(1, height // 2))
            if by_beats or rng.random() < 0.5:
                self.event("stop", hold=True)
                self.row = None
            else:
                self.row, self.image = 0, rng.randrange(MILD)
                self.part_of_a_line(1, start=1)

    def part_of_a_line(self, length: int, *, start: int = 0) -> None:
        """The rest of the line is sent before whatever comes next on its own."""
        self.line(length, last=0, start=start)
        self.begun = length

    def rest_of_the_line(self) -> None:
        begun, whole = self.begun, self.shape.line_beats
        if begun:
            self.begun = 0
            if self.rng.random() < 0.8:
                for k in range(begun, whole):
                    self.fault.beats.append([self.image, self.row, k, int(k == whole - 1), 0, self.pause()])
                self.step()
