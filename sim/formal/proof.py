"""A proof: a component, the bench that states its properties, and copies broken on purpose that must fail."""

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.solve import Answer, solve


@dataclass(frozen=True)
class Proof:
    """Properties of one component, and what they are worth.

    name : unique, lower case, for files and the command line
    component : the class under proof
    size : in words, the parameters that the bench chooses, and why they stand for others
    bench : makes the bench around an instance of the class that it is given
    depth : clocks of the k-induction, or with `bound` the clocks that are checked from the start
    bound : why the proof is bounded, and what the bound covers; empty: it holds for all time
    breaks : (text, replacement) in the component's source; each makes a copy whose properties must fail
    broken_depth : clocks within which a broken copy fails
    quick : takes a few seconds and runs in `make test`
    """

    name: str
    component: type
    size: str
    bench: Callable[[type], FormalBench]
    depth: int
    breaks: tuple[tuple[str, str], ...]
    bound: str = ""
    broken_depth: int = 16
    quick: bool = False

    def run(self, folder: Path, limit_s: int = 600) -> Answer:
        """Prove the properties; the solver's files go to `folder`."""
        bench = self.bench(self.component)
        return solve(bench, folder, depth=self.depth, bounded=bool(self.bound), limit_s=limit_s)

    def run_broken(self, index: int, folder: Path, limit_s: int = 600) -> Answer:
        """Check the properties on the broken copy `index`, from the start on; they should fail."""
        bench = self.bench(broken(self.component, *self.breaks[index]))
        return solve(bench, folder, depth=self.broken_depth, bounded=True, limit_s=limit_s)


def broken(component: type, text: str, replacement: str) -> type:
    """A copy of a class with `replacement` in place of `text`, which must be in its source once."""
    source = inspect.getsource(component)
    if source.count(text) != 1:
        raise ValueError(
            f"{component.__name__}: {text!r} is in its source {source.count(text)} times, not once"
        )
    names = dict(vars(sys.modules[component.__module__]))
    exec(compile(source.replace(text, replacement), f"<broken {component.__name__}>", "exec"), names)
    return names[component.__name__]
