"""A proof by trying: hardware beside a component gives it every operand, and counts wrong results."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from amaranth import Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from fastac.gateware.target.elaboration import to_rtlil
from fastac.sim.formal.proof import broken
from fastac.sim.formal.solve import Answer
from fastac.sim.runner import simulate
from fastac.store.files import content_hash


class Trial(wiring.Component):
    """Hardware that tries all cases: `cases` were tried, in `different` of them the result was wrong.

    A subclass drives the ports; `done` is high from the end of the last case on.
    """

    cases: Out(32)
    different: Out(32)
    done: Out(1)

    def count(self, m: Module, tried: list[Value], wrong: list[Value]) -> None:
        """Count the cases of one clock: whether each was tried, and whether its result is wrong."""
        m.d.sync += [
            self.cases.eq(self.cases + sum(tried)),
            self.different.eq(self.different + sum(t & w for t, w in zip(tried, wrong, strict=True))),
        ]


@dataclass(frozen=True)
class Tried(Answer):
    """An answer that says how many cases were tried."""

    cases: int


@dataclass(frozen=True)
class Exhaustive:
    """All operands of one component, tried in a simulation with Verilator.

    name, component, size, breaks, quick : as in `Proof`
    compares : what must hold of each case, in words; a failure prints it
    trial : makes the hardware around the class that it is given
    cases : their number; another number of tried cases is a failure
    clocks : an upper limit of the clocks that they take
    """

    name: str
    component: type
    size: str
    compares: str
    trial: Callable[[type], Trial]
    cases: int
    clocks: int
    breaks: tuple[tuple[str, str], ...]
    quick: bool = False

    bound = ""

    @property
    def extent(self) -> str:
        """For what the answer holds, in words."""
        return f"all {self.cases:,} cases"

    def made(self, index: int | None = None) -> Trial:
        """The hardware around the component, or around its broken copy `index`."""
        return self.trial(self.component if index is None else broken(self.component, *self.breaks[index]))

    def key(self, index: int | None = None) -> str:
        """Digest of the hardware and of what is expected of it."""
        return content_hash(to_rtlil(self.made(index)), self.cases, self.clocks)

    def properties(self) -> tuple[str, ...]:
        """What is compared, as the only property."""
        return (self.compares,)

    def run(self, folder: Path, index: int | None = None) -> Tried:
        """Try all cases, or try them on the broken copy `index`, where they should fail.

        The simulator's files go to `folder`.
        """
        begun = time.monotonic()
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "found.json"
        path.unlink(missing_ok=True)
        simulate(
            self.made(index),
            "trial",
            "fastac.sim.benches.exhaustive",
            folder,
            build_args=("--output-split", "0"),
            log_file=folder / "simulation.log",
            FOUND=str(path.resolve()),
            CLOCKS=str(self.clocks),
        )
        found = json.loads(path.read_text())
        failed = []
        if found["different"]:
            failed.append(f"{self.compares}: {found['different']} differ")
        if found["cases"] != self.cases:
            failed.append(f"{self.cases} cases: {found['cases']} were tried")
        return Tried("fail" if failed else "pass", tuple(failed), time.monotonic() - begun, found["cases"])
