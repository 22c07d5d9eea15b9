"""A proof: a component, the bench that states its properties, and copies broken on purpose that must fail."""

import inspect
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fastac.sim.formal.bench import FormalBench, Question
from fastac.sim.formal.solve import Answer, solve
from fastac.store.files import content_hash


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

    @property
    def extent(self) -> str:
        """For what the answer holds, in words."""
        return f"{self.depth} clocks from the start: {self.bound}" if self.bound else "all time"

    def question(self, index: int | None = None) -> Question:
        """What is asked of the component, or of its broken copy `index`."""
        component = self.component if index is None else broken(self.component, *self.breaks[index])
        return self.bench(component).question()

    def key(self, index: int | None = None) -> str:
        """Digest of the question and the settings."""
        question = self.question(index)
        depth = self.depth if index is None else self.broken_depth
        return content_hash(question.rtlil, dict(question.probes), question.assertions, depth, self.bound)

    def properties(self) -> tuple[str, ...]:
        """The names of the assertions."""
        return self.question().assertions

    def run(self, folder: Path, index: int | None = None, limit_s: int = 600) -> Answer:
        """Prove the properties, or check them on the broken copy `index`, where they should fail.

        A broken copy is checked from the start on for `broken_depth` clocks. The solver's files go to
        `folder`.
        """
        question = self.question(index)
        if index is None:
            return solve(question, folder, depth=self.depth, bounded=bool(self.bound), limit_s=limit_s)
        return solve(question, folder, depth=self.broken_depth, bounded=True, limit_s=limit_s)


_parsing = threading.Lock()
"""Python 3.11 fails if two threads parse source at the same time (its count of the recursion is shared)."""


def broken(component: type, text: str, replacement: str) -> type:
    """A copy of a class with `replacement` in place of `text`, which must be in its source once."""
    with _parsing:
        source = inspect.getsource(component)
    if source.count(text) != 1:
        raise ValueError(
            f"{component.__name__}: {text!r} is in its source {source.count(text)} times, not once"
        )
    names = dict(vars(sys.modules[component.__module__]))
    with _parsing:
        code = compile(source.replace(text, replacement), f"<broken {component.__name__}>", "exec")
    exec(code, names)
    return names[component.__name__]
