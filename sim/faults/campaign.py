"""The fault campaign: batches of faults through every design, the bins that they fill, and the evidence."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from fastac.sim.faults.batch import batch, numbers_of, play
from fastac.sim.faults.coverage import PLACES, Coverage, impossible
from fastac.sim.faults.designs import DESIGNS, FLOPS, OTHER, OWN, SOURCE, elaborate
from fastac.sim.faults.generator import faults, goal_of
from fastac.sim.faults.golden import Hardware
from fastac.sim.faults.kinds import KINDS, STATES
from fastac.store.evidence import Evidence, Table
from fastac.store.side_by_side import perform_all
from fastac.store.steps import Step
from fastac.store.store import Store, open_store

BATCH = 75
"""Faults of one simulator; as many are repeated at most to see a failure again."""
FAULTS = 10_200
ROUNDS, DIRECTED = 4, 4
"""Rounds in which kinds and states that were not reached are tried again, and how often in each design."""
NOT_COVERED = (
    "Power-up randomises all flip-flops but those that a reset keeps on purpose: the loaded calibration, and two"
    " bits that let the background be written. Memories keep their contents.",
    "Taking a new background while faults happen: tests/gateware/test_top_zynq.py has one reset inside it.",
    "Which of several saturations or late results a soft reset cuts off depends on clocks; there a flag may"
    " stand or not. Everywhere else the flags are exact.",
    "The timeout's exact clock, with which tests/gateware/stream/test_frame_guard.py deals: here a pause is"
    " clearly shorter, or lasts until the flag stands.",
    "Images larger than 20 × 20 pixels, and faults of single bits inside the hardware (radiation).",
    "FrameGuard's state is read from the simulated hardware's register; no port shows it.",
)


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
        perform_all(self.store_folder, steps, self.jobs, label="batches of faults", progress=self.progress)
        for (design, _), step in zip(order, steps, strict=True):
            value = self.store.perform(step).value
            self.records += [(design, record) for record in value["records"]]
            self.seconds[design] += value["seconds"]

    def evidence(self, coverage: Coverage, command: str, seconds: float) -> Evidence:
        records = [record for _, record in self.records]
        frames = sum(record["frames"] for record in records)
        missing = [f"{kind} in {state}" for kind, state in coverage.missing()]
        reached = sum(len(kind.states()) for kind in KINDS.values()) - len(missing)
        summary = (
            f"{len(records):,} faults through {len(self.designs)} designs, seed {self.seed}: after each the next"
            f" good frame was exact on every output, and the right flags stood. {frames:,} frames were compared,"
            f" repaired ones included. {reached} of {reached + len(missing)} possible pairs of a kind of fault and"
            f" a state of the frame guard were reached. The AXI rules were checked in each of"
            f" {sum(record['clocks'] for record in records):,} clocks. Processor time of all batches:"
            f" {sum(self.seconds.values()) / 60:.0f} minutes."
        )
        return Evidence(
            name="faults",
            title="Faults and misuse",
            command=command,
            summary=summary,
            seconds=seconds,
            tables=[
                self._by_design(),
                self._by_kind(coverage),
                self._cross(coverage),
                self._places(coverage),
                self._second(coverage),
            ],
            not_covered=[
                *(f"Not reached: {text}." for text in missing),
                *(f"Cannot be: {', '.join(names)}: {reason}." for reason, names in impossible().items()),
                *NOT_COVERED,
            ],
        )

    def _by_design(self) -> Table:
        rows = []
        for design in self.designs:
            mine = [record for name, record in self.records if name == design]
            total = {
                key: sum(record[key] for record in mine)
                for key in ("frames", "bad", "beats", "results", "clocks")
            }
            wanted = DESIGNS[design]
            solver = wanted.get("solver", "dst2d") if wanted["outputs"] != ("normals",) else "none"
            rows.append(
                [
                    design,
                    solver,
                    wanted.get("lanes", 1),
                    ", ".join(wanted["outputs"]),
                    wanted.get("weights", "loadable"),
                    *(f"{number:,}" for number in (len(mine), *total.values())),
                    f"{self.seconds[design]:.0f}",
                ]
            )
        columns = ["design", "solver", "pixels a clock", "outputs", "weights", "faults", "frames compared"]
        columns += ["of these repaired", "output beats compared", "results read", "clocks", "seconds"]
        return Table("By design", columns, rows)

    def _by_kind(self, coverage: Coverage) -> Table:
        first, flags = Counter(), {}
        for _, record in self.records:
            first[record["kinds"][0]] += 1
            if len(record["kinds"]) == 1:
                flags.setdefault(record["kinds"][0], Counter()).update(record["errors"])
        rows = []
        for name, kind in KINDS.items():
            second = sum(count for (_, other), count in coverage.pairs.items() if other == name)
            seen = ", ".join(f"{flag} {count}" for flag, count in flags.get(name, Counter()).most_common(4))
            designs = sum(coverage.designs[name, design] > 0 for design in self.designs)
            rows.append([name, kind.meaning, first[name], second, designs, seen])
        columns = ["kind", "what happens", "faults", "as second", "designs", "flags that stood, when alone"]
        note = (
            "A third of the faults have a second one in the same frame. Frames before a fault may be faulty too,"
            " where that is the way into a state. The flags compared are all of ERRORS; the four most frequent are"
            " listed."
        )
        return Table("By kind of fault", columns, rows, note)

    def _cross(self, coverage: Coverage) -> Table:
        rows = [
            [name, *(coverage.states[name, s] if s in kind.states() else "impossible" for s in STATES)]
            for name, kind in KINDS.items()
        ]
        note = (
            "The state of the frame guard in the clock in which the fault begins: the first beat of the faulty line"
            " or frame is accepted, a reset or a register write takes effect, a pause or a stall begins. WAIT:"
            " between frames; LINE: inside a frame; DROP: surplus beats of a line are dropped; PAD: a short line is"
            " padded; FILL: a frame is padded."
        )
        return Table("Kinds of faults × states of the frame guard", ["kind", *STATES], rows, note)

    def _places(self, coverage: Coverage) -> Table:
        slow = sorted({share for _, share in coverage.stalls})
        rows = [
            [
                name,
                *(coverage.places[name, place] for place in PLACES),
                *(coverage.stalls[name, share] for share in slow),
            ]
            for name in KINDS
        ]
        columns = ["kind", *PLACES, *(f"outputs stalled {share:.0%} of the clocks" for share in slow)]
        return Table("Where in the camera's frame, and at which stalls", columns, rows)

    def _second(self, coverage: Coverage) -> Table:
        firsts = Counter(len([1 for (a, _) in coverage.pairs if a == name]) for name in KINDS)
        rows = [[count, firsts[count]] for count in sorted(firsts)]
        return Table(
            "Two faults in one frame",
            ["different second faults", "kinds of first faults that had so many"],
            rows,
            f"{sum(coverage.pairs.values()):,} faults had a second one, in {len(coverage.pairs)} different pairs.",
        )
