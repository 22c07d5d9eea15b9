"""What a bench in another simulator has found, read from the lines that it prints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fastac.sim.independent.stimulus import Stimulus


class SimulatorError(RuntimeError):
    """A simulator is missing, does not take the design, or its bench came to no end; one line."""


@dataclass(frozen=True)
class Outcome:
    """A run: what was compared, what differed, and in which clocks things happened.

    values, markers : words of the output streams, and their tlast, tuser and tkeep, that were compared
    registers : reads of registers that were compared, forces included
    differences : of all of these, and surplus beats
    unknown : unknown bits in what outputs offer and in what offers and accepts, summed over all clocks after
        reset; None: a simulator without unknowns
    idle_unknown : the same of payloads while they are not offered, where AXI allows anything
    violations : clocks in which a stream or bus withdrew or changed what it had offered
    first : the first complaint
    starts, results : clocks of each frame's first beat and of the rises of the interrupt
    ends : by output stream, clocks of each frame's last beat
    """

    frames: int
    clocks: int
    values: int
    markers: int
    registers: int
    differences: int
    unknown: int | None
    idle_unknown: int | None
    violations: int
    first: str
    starts: Sequence[int]
    results: Sequence[int]
    ends: Mapping[str, Sequence[int]]
    build_s: float = 0.0
    run_s: float = 0.0

    @property
    def clean(self) -> bool:
        """Whether nothing at all was found."""
        return self.differences == 0 and not self.unknown and self.violations == 0

    @property
    def first_pixel_to_result(self) -> int:
        """Clocks of the first frame from its first beat to its result, one before the interrupt rises."""
        return self.results[0] - 1 - self.starts[0]


def parsed(text: str, stimulus: Stimulus, *, four_states: bool) -> Outcome:
    """The outcome that a bench has printed; raises SimulatorError if it did not come to its end.

    A bench that compared less than it was given has not come to its end either.
    """
    lines = [line.split() for line in text.splitlines()]

    def of(kind: str) -> list[list[str]]:
        return [line[1:] for line in lines if line and line[0] == kind]

    first = next((" ".join(line) for line in of("FIRST")), "")
    if not of("DONE"):
        raise SimulatorError(f"the bench came to no end: {first or 'it printed ' + repr(text[-200:])}")
    streams = [[int(n) for n in line[1:]] for line in of("STREAM")]
    columns = zip(*streams, [0, 0, 0, 0], strict=True)
    values, markers, differences, violations = (sum(column) for column in columns)
    registers, wrong, broken = (int(n) for n in of("HOST")[0])
    clocks, unknown, idle_unknown = (int(n) for n in of("DONE")[0])
    ends: dict[str, list[int]] = {}
    for name, clock in of("END"):
        ends.setdefault(name, []).append(int(clock))
    if values != stimulus.values:
        raise SimulatorError(f"the bench compared {values} of {stimulus.values} values: {first}")
    return Outcome(
        frames=stimulus.frames,
        clocks=clocks,
        values=values,
        markers=markers,
        registers=registers,
        differences=differences + wrong,
        unknown=unknown if four_states else None,
        idle_unknown=idle_unknown if four_states else None,
        violations=violations + broken,
        first=first,
        starts=[int(n) for (n,) in of("START")],
        results=[int(n) for (n,) in of("RESULT")],
        ends=ends,
    )
