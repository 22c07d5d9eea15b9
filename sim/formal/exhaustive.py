"""A proof by trying: hardware beside a component gives it every operand, and counts wrong results."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from amaranth import Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from fastac.sim.formal.proof import broken
from fastac.sim.formal.solve import Answer
from fastac.sim.runner import simulate


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
    compares : what is compared, in words; a failure prints it
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

    def run(self, folder: Path) -> Tried:
        """Try all cases; the simulator's files go to `folder`."""
        return self._run(self.component, folder)

    def run_broken(self, index: int, folder: Path) -> Tried:
        """Try all cases on the broken copy `index`, which should fail."""
        return self._run(broken(self.component, *self.breaks[index]), folder)

    def _run(self, component: type, folder: Path) -> Tried:
        begun = time.monotonic()
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "found.json"
        path.unlink(missing_ok=True)
        simulate(
            self.trial(component),
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
