"""The fault campaign: batches of faults through every design, the bins that they fill, and the evidence."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from fastac.sim.faults.batch import batch, numbers_of, play
from fastac.sim.faults.coverage import Coverage
from fastac.sim.faults.designs import FLOPS, OTHER, OWN, SOURCE, elaborate
from fastac.sim.faults.generator import faults, goal_of
from fastac.sim.faults.golden import Hardware
from fastac.store.progress import progress_bar
from fastac.store.side_by_side import perform_all
from fastac.store.steps import Step
from fastac.store.store import Store, open_store

BATCH = 75
"""Faults of one simulator; as many are repeated at most to see a failure again."""
FAULTS = 10_200
ROUNDS, DIRECTED = 4, 4
"""Rounds in which kinds and states that were not reached are tried again, and how often in each design."""


def design_step(design: str) -> Step:
    return Step("fault_design", elaborate, {"design": design}, (OWN, OTHER, SOURCE, FLOPS))


def batch_step(design: str, numbers: Sequence[int], seed: int, workplace: Path, *, progress: bool) -> Step:
    source = design_step(design)
    arguments = {
        "design": design,
        "own": source.output(OWN),
        "other": source.output(OTHER),
        "verilog": source.output(SOURCE),
        "flip_flops": source.output(FLOPS),
        "numbers": list(numbers),
        "seed": seed,
    }
    return Step("faults", batch, arguments, (), {"workplace": workplace, "progress": progress})


class Campaign:
    """Faults of one seed through some designs; what has been played is kept in the store.

    workplace : folder for simulators; jobs : processes
    """

    def __init__(
        self, designs: Sequence[str], seed: int, store: Path, workplace: Path, *, jobs: int, progress: bool
    ):
        self.designs, self.seed, self.store_folder, self.workplace = designs, seed, store, workplace
        self.jobs, self.progress = jobs, progress
        self.records: list[tuple[str, dict]] = []
        self.seconds: Counter[str] = Counter()

    @property
    def store(self) -> Store:
        return open_store(self.store_folder)

    def run(self, count: int, rounds: int = ROUNDS) -> Coverage:
        """At least `count` faults, spread evenly, and more where kinds and states were not reached.

        Raises FaultFound at the first failure; what had been played by then is kept.
        """
        each = -(-count // len(self.designs))
        plan = {
            design: [list(range(k, min(k + BATCH, each))) for k in range(0, each, BATCH)]
            for design in self.designs
        }
        self.play(plan)
        coverage = Coverage(self.records)
        for turn in range(rounds):
            missing = set(coverage.missing())
            if not missing:
                break
            self.play({design: self.directed(design, missing, each, turn) for design in self.designs})
            coverage = Coverage(self.records)
        return coverage

    def directed(self, design: str, missing: set, after: int, turn: int) -> list[list[int]]:
        """Numbers of faults beyond `after` that aim at what is missing, as one batch or none."""
        shape, found = self.hardware(design).shape, []
        aims: Counter[tuple[str, str]] = Counter()
        for number in range(after, after + 200 * (turn + 1) * DIRECTED):
            goal = goal_of(shape, design, self.seed, number)
            aims[goal] += goal in missing
            if goal in missing and turn * DIRECTED < aims[goal] <= (turn + 1) * DIRECTED:
                found.append(number)
        return [found] if found else []

    def repeat(self, design: str, numbers: str) -> int:
        """Play the faults with these numbers, as `spans` gives them, whatever is kept; returns how many.

        Raises FaultFound, and ValueError for a text that gives no numbers.
        """
        chosen, entry = numbers_of(numbers), self.store.perform(design_step(design))
        hardware = self.hardware(design)
        played = play(
            hardware,
            entry.path(SOURCE),
            entry.path(FLOPS),
            faults(hardware.shape, design, self.seed, chosen),
            self.seed,
            self.workplace / f"{design}_again",
        )
        return len(played)

    def hardware(self, design: str) -> Hardware:
        entry = self.store.perform(design_step(design))
        return Hardware.load(entry.path(OWN), entry.path(OTHER))

    def play(self, plan: dict[str, list[list[int]]]) -> None:
        """Perform batches side by side; those of all designs come in turn."""
        for design in plan:
            self.store.perform(design_step(design))
        # A design's first batch compiles its simulator, for which others would only wait.
        longest = max(map(len, plan.values()))
        order = [
            (design, batches[k])
            for k in range(longest)
            for design, batches in plan.items()
            if k < len(batches)
        ]
        steps = [
            batch_step(design, numbers, self.seed, self.workplace, progress=self.progress)
            for design, numbers in order
        ]
        label = "batches of faults"
        if self.jobs > 1:
            perform_all(self.store_folder, steps, self.jobs, label=label, progress=self.progress)
        # With one process the batches are played here, else they are only read.
        shown = progress_bar(steps, desc=label, enabled=self.progress and self.jobs == 1)
        for (design, _), step in zip(order, shown, strict=True):
            value = self.store.perform(step).value
            self.records += [(design, record) for record in value["records"]]
            self.seconds[design] += value["seconds"]
