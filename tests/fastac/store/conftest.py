"""A toy project whose files the tests change, imported anew after each change."""

import importlib
import itertools
import sys
import textwrap
import time
from pathlib import Path

import pytest

from fastac.store.closure import Code
from fastac.store.store import Store

WATCHED = Path(__file__).parents[3] / "scenes" / "watched.py"
FILES = {
    "__init__.py": "",
    "schema.py": """
        from pydantic import ConfigDict
        from ROOT.watched import Watchable


        class Strict(Watchable):
            model_config = ConfigDict(extra="forbid", frozen=True)


        class Numbers(Strict):
            fraction_bits: int = 14
            limit_bits: int = 2
            weight_bits: int = 8

            @property
            def slope_bits(self) -> int:
                return self.fraction_bits + self.limit_bits

            @property
            def weight_range(self) -> int:
                return 2**self.weight_bits

            def total(self) -> int:
                return self.fraction_bits + self.weight_bits


        class Markers(Strict):
            spacing_mm: float = 1.6


        class Scene(Strict):
            name: str = "toy"
            solver: str = "fast"
            numbers: Numbers = Numbers()
            markers: Markers | None = None
        """,
    "words.py": """
        FACTOR = 3
        UNUSED = 4


        def round_to(value, bits):
            '''Rounds.'''
            return value * FACTOR + bits


        def unrelated():
            return 1
        """,
    "middle.py": """
        from .words import round_to


        def scaled(value, bits):
            return round_to(value, bits)
        """,
    "solvers.py": """
        from fastac.store.kinds import Kinds


        class Fast:
            def solve(self):
                return 1


        class Exact:
            def solve(self):
                return 2


        SOLVERS = Kinds("solver", {"fast": Fast, "exact": Exact})
        """,
    "steps.py": """
        import json
        from pathlib import Path

        from ROOT import middle
        from ROOT.schema import Scene
        from ROOT.solvers import SOLVERS


        def slopes(folder: Path, scene: Scene, value=1):
            (folder / "slopes.txt").write_text(str(middle.scaled(value, scene.numbers.slope_bits)))


        def weights(folder: Path, scene: Scene):
            (folder / "weights.txt").write_text(str(scene.numbers.weight_range))


        def solved(folder: Path, scene: Scene) -> int:
            return SOLVERS[scene.solver]().solve()


        def listed(folder: Path) -> list:
            return list(SOLVERS)


        def parity(folder: Path, number):
            (folder / "parity.txt").write_text(str(number % 2))


        def doubled(folder: Path, source: Path):
            (folder / "doubled.txt").write_text(source.read_text() * 2)


        def page(folder: Path) -> str:
            return Path(__file__).with_name("page.html.j2").read_text()


        def bench(folder: Path) -> str:
            return "ROOT.benches.top"
        """,
    "page.html.j2": "page",
    "benches/__init__.py": "",
    "benches/top.py": "LEVEL = 1\n",
}
_numbers = itertools.count()


class Toy:
    """A project below `tmp_path`, with a store; each `store()` is what a new process would have."""

    def __init__(self, folder: Path):
        self.name = f"toy{next(_numbers)}_{folder.name.replace('-', '_')}"
        self.folder = folder / self.name
        self.kept = folder / "store"
        for name, text in FILES.items():
            self.write(name, text)
        self.write("watched.py", WATCHED.read_text())

    def write(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(textwrap.dedent(text).replace("ROOT", self.name))
        self.forget()

    def edit(self, name: str, old: str, new: str) -> None:
        text = (self.folder / name).read_text()
        assert text.count(old) == 1, old
        self.write(name, text.replace(old, new))

    def forget(self) -> None:
        for module in [m for m in sys.modules if m.split(".")[0] == self.name]:
            del sys.modules[module]
        importlib.invalidate_caches()

    def module(self, name: str):
        return importlib.import_module(f"{self.name}.{name}")

    def function(self, name: str):
        return getattr(self.module("steps"), name)

    def scene(self, **changes):
        return self.module("schema").Scene.model_validate(changes)

    def code(self) -> Code:
        # The toy's files are always younger than this process.
        return Code(
            {self.name: self.folder}, watchable=f"{self.name}.watched.Watchable", since=time.time_ns()
        )

    def store(self) -> Store:
        return Store(self.kept, self.code())


@pytest.fixture
def toy(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # same size and second would read as unchanged
    toy = Toy(tmp_path)
    yield toy
    toy.forget()
