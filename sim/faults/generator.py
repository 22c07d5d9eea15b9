"""Seeded generator of faults: each kind in each state of the frame guard, alone or with a second fault."""

import random
from collections.abc import Sequence

from fastac.sim.faults.kinds import SECOND, kinds_of
from fastac.sim.faults.script import MILD, STRONG, Fault, Script, Shape


def goals(shape: Shape) -> list[tuple[str, str]]:
    """Every kind with every state in which it can begin."""
    kinds = kinds_of(shape.streams, loadable=shape.loadable)
    return [(name, state) for name, kind in kinds.items() for state in kind.states()]


def goal_of(shape: Shape, design: str, seed: int, number: int) -> tuple[str, str]:
    """Kind and state of the fault with this number: all of `goals` in turn, in another order each round."""
    wanted = goals(shape)
    turn, place = divmod(number, len(wanted))
    return random.Random(f"{design} {seed} round {turn}").sample(wanted, len(wanted))[place]


def faults(shape: Shape, design: str, seed: int, numbers: Sequence[int]) -> list[Fault]:
    """The faults with these numbers; each depends on the design, the seed and its own number only."""
    return [
        _FaultScript(
            shape,
            random.Random(f"{design} {seed} fault {number}"),
            number,
            *goal_of(shape, design, seed, number),
        ).fault
        for number in numbers
    ]


class _FaultScript(Script):
    """Writes one fault: frames before it, the way into the guard's state, the fault, the good frame."""

    def __init__(self, shape: Shape, rng: random.Random, number: int, kind: str, state: str):
        kinds, states = [kind], [state]
        if rng.random() < 0.3 and not kind.startswith("calibration"):
            possible = kinds_of(shape.streams, loadable=shape.loadable)
            kinds.append(rng.choice([name for name in SECOND if name in possible]))
            states.append(None)
        super().__init__(shape, rng, Fault(number, kinds, states))
        self.fault.slow_outputs = rng.choice([0, 0, 0, 0.2, 0.6]) if shape.streams else 0
        self.fault.serves = rng.random() < 0.7
        for _ in range(rng.choice([0, 1, 1, 2])):
            self.whole_frame()
        self.lead_in(kind, state)
        for place, name in enumerate(kinds):
            self.target = states[place]
            getattr(self, f"_{name}")(place)
        if self.row is not None and rng.random() < 0.6:
            self.lines(self.shape.height - self.row)
        for _ in range(rng.choice([1, 1, 1, 2])):
            self.good_frame()

    # Kinds made of beats

    def mark(self, place: int) -> None:
        """The fault begins with the next beat, for which the guard's state is waited."""
        self.rest_of_the_line()
        self.fault.marks[len(self.fault.beats)] = place
        if self.target in ("WAIT", "LINE", "PAD", "FILL"):
            self.event("go", state=self.target, hold=True)

    def faulty_line(self, place: int, length: int, *, last: int) -> None:
        self.mark(place)
        starts = self.row is None
        if starts:
            self.row, self.image = 0, self.rng.randrange(MILD)
        self.line(length, last=last, start=int(starts))
        self.fault.beats[-length][-1] = 0
        self.step()

    def _line_short(self, place: int) -> None:
        self.faulty_line(place, self.rng.randint(1, self.shape.line_beats - 1), last=1)

    def _line_long(self, place: int) -> None:
        self.faulty_line(place, self.shape.line_beats + self.rng.randint(1, 5), last=1)

    def _line_unended(self, place: int) -> None:
        self.faulty_line(place, self.shape.line_beats + self.rng.choice([0, 0, 3]), last=0)

    def faulty_frame(self, place: int, lines: int) -> None:
        self.mark(place)
        self.row = None
        first = len(self.fault.beats)
        self.lines(lines)
        self.fault.beats[first][-1] = 0

    def _frame_short(self, place: int) -> None:
        self.faulty_frame(place, self.rng.randint(1, self.shape.height - 1))
        self.row = None

    def _frame_cut(self, place: int) -> None:
        self.faulty_frame(place, self.rng.randint(1, self.shape.height - 1))
        self.line(self.rng.randint(1, self.shape.line_beats - 1), last=0)
        self.row = None

    def _frame_long(self, place: int) -> None:
        self.faulty_frame(place, self.shape.height)
        for _ in range(self.rng.randint(1, 3)):
            self.line(row=0)

    def _overload(self, place: int) -> None:
        self.faulty_frame(place, 1)
        first = self.fault.marks and max(self.fault.marks)
        self.image = MILD + self.rng.randrange(STRONG)
        for beat in self.fault.beats[first:]:
            beat[0] = self.image
        self.lines(self.shape.height - 1)

    def _garbage(self, place: int) -> None:
        self.mark(place)
        rng = self.rng
        ends, starts = rng.choice([(0.3, 0.05), (0.05, 0.02), (0.5, 0.5)])
        for k in range(rng.randint(5, 2 * self.shape.line_beats + 20)):
            pixel = [rng.randrange(MILD), rng.randrange(self.shape.height), k % self.shape.line_beats]
            pause = 0 if k == 0 else self.pause()
            self.fault.beats.append([*pixel, int(rng.random() < ends), int(rng.random() < starts), pause])
        self.row = None

    def _no_start(self, place: int) -> None:
        self.event(self.rng.choice(["soft_reset", "hard_reset"]), hold=True)
        self.event("join", hold=True)
        self.mark(place)
        self.row = self.rng.randrange(1, self.shape.height - 3)
        self.lines(self.rng.randint(1, 3))
        self.row = None

    # Kinds that begin beside the stream

    def act(self, place: int, do: str, *, hold: bool = True, **settings) -> None:
        """What happens once the guard is in the state that is wanted; without one, at a random beat."""
        rng = self.rng
        if self.target is None:
            self.some_beats()
            self.event(do, delay=rng.randint(0, 20), hold=do == "stop", place=place, **settings)
            self.some_beats()
            return
        delay = rng.randint(0, 6) if self.target in ("WAIT", "LINE", "DROP") else rng.choice([0, 0, 1, 2])
        self.event(do, state=self.target, delay=delay, hold=hold, place=place, **settings)
        self.rest_of_the_line()

    def some_beats(self) -> None:
        """A few more lines of the frame, or of a new one."""
        self.rest_of_the_line()
        self.lines(self.rng.randint(0, 2))

    def _camera_stops(self, place: int) -> None:
        self.act(place, "stop")
        if self.row is not None and self.rng.random() < 0.5:
            self.row = None  # otherwise the rest of the frame comes late

    def _camera_pauses(self, place: int) -> None:
        self.act(place, "pause", clocks=self.rng.randint(5, 60))

    def _input_stalls(self, place: int) -> None:
        self.act(place, "go")
        start = len(self.fault.beats)
        self.lines(self.rng.randint(2, self.shape.height))
        odds = self.rng.uniform(0.2, 0.9)
        for beat in self.fault.beats[start:]:
            beat[-1] = self.rng.randint(1, 30) if self.rng.random() < odds / 4 else self.pause()

    def _output_stalls(self, place: int) -> None:
        which = self.rng.choice([*range(self.shape.streams), None])
        clocks = self.rng.randint(10, 2 * self.shape.beats)
        self.act(place, "stall", which=which, clocks=clocks, share=self.rng.uniform(0.3, 0.95))

    def _output_blocked(self, place: int) -> None:
        self.block(place, self.rng.randrange(self.shape.streams))

    def _outputs_blocked(self, place: int) -> None:
        self.block(place, None)

    def block(self, place: int, which: int | None) -> None:
        clocks = round(self.rng.uniform(1, 3) * self.shape.beats) + self.rng.randint(0, 100)
        self.act(place, "stall", which=which, clocks=clocks, share=1.0)
        if self.rng.random() < 0.7:
            self.rest_of_the_line()
            if self.row is not None:
                self.lines(self.shape.height - self.row)
            self.whole_frame()

    def _disabled(self, place: int) -> None:
        self.act(place, "disable")
        if self.row is not None and self.rng.random() < 0.7:
            self.lines(self.shape.height - self.row)
        if self.rng.random() < 0.6:
            self.row = None
            self.lines(self.rng.randint(1, self.shape.height))
        self.event("enable", delay=self.rng.randint(0, 20))
        self.some_beats()

    def _soft_reset(self, place: int) -> None:
        self.act(place, "soft_reset")

    def _soft_reset_blocked(self, place: int) -> None:
        which = self.rng.choice([*range(self.shape.streams), None])
        clocks = self.rng.randint(20, 2 * self.shape.beats)
        self.act(place, "soft_reset", block=which, clocks=clocks)

    def _hard_reset(self, place: int) -> None:
        self.act(place, "hard_reset", clocks=self.rng.randint(1, 3), camera_runs=self.rng.random() < 0.5)

    def _hard_reset_in_read(self, place: int) -> None:
        self.act(place, "hard_reset", inside="read", after=self.rng.randint(1, 8))

    def _hard_reset_in_write(self, place: int) -> None:
        self.act(place, "hard_reset", inside="write", after=self.rng.randint(1, 8))

    def _power_up(self, place: int) -> None:
        self.act(place, "hard_reset", randomise=True, clocks=self.rng.randint(1, 3))

    def _registers_read(self, place: int) -> None:
        self.act(place, "registers_read")

    def _registers_absent(self, place: int) -> None:
        self.act(place, "registers_absent", count=self.rng.randint(1, 6))

    def _registers_refused(self, place: int) -> None:
        self.act(place, "registers_refused", count=self.rng.randint(1, 6))

    def _calibration_busy(self, place: int) -> None:
        if self.target == "WAIT":
            self.whole_frame()
        self.act(place, "calibration_busy")

    def _calibration_foreign(self, place: int) -> None:
        self.act(place, "calibration_foreign", bit=self.rng.randrange(32))

    def calibrate(self, place: int, **settings) -> None:
        self.event("idle", hold=True)
        self.event(
            "calibrate",
            state=self.target,
            delay=self.rng.randint(0, 5),
            hold=True,
            place=place,
            image=self.rng.choice(["own", "other"]),
            **settings,
        )
        self.row = None
        # Held until the last word; or a frame comes meanwhile, whose first beat then waits.
        self.event("loading" if self.rng.random() < 0.5 else "join", hold=True)
        self.whole_frame()

    def _calibration_loaded(self, place: int) -> None:
        self.calibrate(place)

    def _calibration_restarted(self, place: int) -> None:
        self.calibrate(place, cut=self.rng.random(), by="restart")

    def _calibration_reset(self, place: int) -> None:
        self.calibrate(place, cut=self.rng.random(), by=self.rng.choice(["soft_reset", "hard_reset"]))
