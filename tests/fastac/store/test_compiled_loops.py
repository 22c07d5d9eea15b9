import os
import subprocess
import sys

import pytest

PARTS = """from fastac.store.compiled_loops import compiled

FACTOR = 3
PAIR = (1, 2)


@compiled()
def deepest(x):
    return x + 1
"""
MIDDLE = """from collections import namedtuple

from fastac.store.compiled_loops import compiled
from parts import deepest

Point = namedtuple("Point", "a b")


@compiled(inline="always")
def between(x):
    return deepest(x) * 10
"""
LOOP = """from fastac.store.compiled_loops import compiled
from middle import Point, between
from parts import FACTOR, PAIR


@compiled()
def whole(x):
    point = Point(PAIR[0], PAIR[1])
    return between(x) + FACTOR * 1000 + point.a * 10_000 + point.b * 100_000
"""
SOURCES = {"parts": PARTS, "middle": MIDDLE, "loop": LOOP}


class Package:
    """A loop and what it is made of, in three files of a folder."""

    def __init__(self, folder):
        self.folder, self.cache = folder, folder / "cache"
        self.write(SOURCES)

    def write(self, sources):
        """Write the files whose text differs; the others keep their times, by which Numba knows a change."""
        for name, text in sources.items():
            path = self.folder / f"{name}.py"
            if not path.exists() or path.read_text() != text:
                path.write_text(text)

    def run(self) -> tuple[int, int]:
        """What the loop finds in a new process, and how much code was kept from an earlier one."""
        environment = os.environ | {"NUMBA_CACHE_DIR": str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", "import loop; f = loop.whole; print(f(4), len(f.stats.cache_hits))"],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        found, kept = done.stdout.split()
        return int(found), int(kept)


@pytest.fixture
def package(tmp_path):
    return Package(tmp_path)


def test_code_is_kept_until_what_it_is_made_of_changes(package):
    assert package.run() == (213_050, 0)
    assert package.run() == (213_050, 1)
    states = {path.name for path in package.cache.iterdir()}
    assert {name.rpartition("-")[0] for name in states} == {"loop.whole", "middle.between", "parts.deepest"}

    for change, expected in (
        ({"parts": PARTS.replace("x + 1", "x + 2")}, 213_060),  # a loop that a loop that it calls calls
        ({"parts": PARTS.replace("FACTOR = 3", "FACTOR = 4")}, 214_050),  # a constant
        ({"parts": PARTS.replace("(1, 2)", "(3, 2)")}, 233_050),
        ({"middle": MIDDLE.replace('"a b"', '"b a"')}, 123_050),  # the fields of a tuple
        ({"middle": MIDDLE.replace("* 10", "* 20")}, 213_100),
    ):
        package.write(SOURCES | change)
        assert package.run() == (expected, 0), change
        assert len(list(package.cache.iterdir())) == len(states), "earlier states are removed"
        package.write(SOURCES)
        assert package.run()[0] == 213_050
