"""What the faults of a campaign have reached: kinds × states of the frame guard, designs and places."""

from collections import Counter
from collections.abc import Iterable

from fastac.sim.faults.kinds import KINDS

PLACES = ("between frames", "first line", "inside", "last line")
"""Where in the camera's frame a fault began."""


class Coverage:
    """Bins of the records of many faults; a fault of two kinds counts for both."""

    def __init__(self, records: Iterable[tuple[str, dict]]):
        self.states: Counter[tuple[str, str]] = Counter()
        self.places: Counter[tuple[str, str]] = Counter()
        self.designs: Counter[tuple[str, str]] = Counter()
        self.stalls: Counter[tuple[str, float]] = Counter()
        self.pairs: Counter[tuple[str, str]] = Counter()
        for design, record in records:
            kinds = record["kinds"]
            if len(kinds) == 2:
                self.pairs[tuple(kinds)] += 1
            for kind, found in zip(kinds, record["states"], strict=True):
                self.designs[kind, design] += 1
                self.stalls[kind, record["slow_outputs"]] += 1
                if found is not None:
                    self.states[kind, found[0]] += 1
                    self.places[kind, found[1]] += 1

    def missing(self) -> list[tuple[str, str]]:
        """Kinds with states that are possible and were not reached."""
        return [
            (kind, state)
            for kind, entry in KINDS.items()
            for state in entry.states()
            if not self.states[kind, state]
        ]

    def unexpected(self) -> list[tuple[str, str]]:
        """Kinds with states that are said to be impossible, and were reached."""
        return [
            (kind, state)
            for (kind, state), count in self.states.items()
            if count and state not in KINDS[kind].states()
        ]


def impossible() -> dict[str, list[str]]:
    """{reason: "kind in STATE, ..."} for every kind with every state in which it cannot begin."""
    found: dict[str, list[str]] = {}
    for name, kind in KINDS.items():
        for state, reason in (kind.impossible or {}).items():
            found.setdefault(reason, []).append(f"{name} in {state}")
    return found
