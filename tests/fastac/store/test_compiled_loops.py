import ast
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numba import config

from fastac.store import compiled_loops
from fastac.store.compiled_loops import compiled

SOURCES = {
    "parts": """import numpy as np
from fastac.store.compiled_loops import compiled

FACTOR = 3
PAIR = (1, 2)


@compiled()
def deepest(x, more=1):
    return min(x + more, 100) + np.floor(0.5)
""",
    "middle": """from collections import namedtuple

from fastac.store.compiled_loops import compiled
from project.parts import deepest

Point = namedtuple("Point", "a b")


@compiled(inline="always")
def between(x):
    return deepest(x) * 10
""",
    "seventh": """from numba.extending import intrinsic


@intrinsic
def seven(context, x):
    def generate(context, builder, signature, values):
        return context.get_constant(x, 7)

    return x(x), generate
""",
    "loop": """from fastac.store.compiled_loops import compiled
from project import (
    parts,  # its pair
    seventh,
)
from project.middle import Point, between
from project.parts import FACTOR

PAIR, seven = parts.PAIR, seventh.seven


@compiled()
def whole(x):
    point = Point(PAIR[0], PAIR[1])
    return between(x) + FACTOR * 1000 + point.a * 10_000 + point.b * 100_000 + seven(1)
""",
    "__init__": "",
    "apart": "import project.loop\n",
}
FOUND = 213_057.0


class Project:
    """A loop and what it is made of, in files of a package."""

    def __init__(self, folder):
        self.folder, self.cache = folder, folder / "cache"
        (folder / "project").mkdir()
        self.write(SOURCES)

    def write(self, sources):
        """Write the files whose text differs; the others stay as they are."""
        for name, text in sources.items():
            path = self.folder / "project" / f"{name}.py"
            if not path.exists() or path.read_text() != text:
                path.write_text(text)

    def run(self, **environment) -> tuple[float, int]:
        """What the loop finds in a new process, and how much code was kept from an earlier one."""
        own = {"NUMBA_CACHE_DIR": str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        code = "import project.loop; f = project.loop.whole; print(f(4), len(f.stats.cache_hits))"
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=self.folder,
            env=os.environ | own | environment,
            capture_output=True,
            text=True,
            check=True,
        )
        found, kept = done.stdout.split()
        return float(found), int(kept)

    def states(self) -> list[str]:
        return sorted(path.name.rpartition("-")[0].rpartition("-")[0] for path in self.cache.iterdir())


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


def test_code_is_kept_while_what_it_is_made_of_stays(project):
    assert project.run() == (FOUND, 0)
    assert project.run() == (FOUND, 1)
    assert project.states() == ["project.loop", "project.middle", "project.parts"]
    project.write({"apart": "import project.loop  # which does not import this file\n"})
    assert project.run() == (FOUND, 1)


CHANGES = {
    "a default, two calls away": ("parts", "more=1", "more=2", FOUND + 10),
    "a function of Python's": ("parts", "min(", "max(", FOUND + 950),
    "one of a library's": ("parts", "np.floor", "np.ceil", FOUND + 10),
    "a constant": ("parts", "FACTOR = 3", "FACTOR = 4", FOUND + 1000),
    "a constant of a module that is imported whole": ("parts", "(1, 2)", "(3, 2)", FOUND + 20_000),
    "the fields of a tuple": ("middle", '"a b"', '"b a"', FOUND - 90_000),
    "an intrinsic": ("seventh", "x, 7", "x, 8", FOUND + 1),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.quick("a function of Python's")
def test_code_is_made_anew_when_what_it_is_made_of_changes(project, change):
    name, before, after, expected = CHANGES[change]
    assert project.run() == (FOUND, 0)
    project.write(SOURCES | {name: SOURCES[name].replace(before, after)})
    assert project.run() == (expected, 0)
    project.write(SOURCES)
    assert project.run() == (FOUND, 1), "the code of the earlier state is still there"


def test_code_of_much_earlier_states_is_removed(project):
    project.run()
    [first] = project.cache.glob("project.loop-*")
    project.write({"loop": SOURCES["loop"].replace("1000", "2000")})
    project.run()
    assert first.exists()
    long_ago = time.time() - (compiled_loops.KEPT_DAYS + 1) * 86_400
    [second] = {*project.cache.glob("project.loop-*")} - {first}
    for state in (first, second):
        os.utime(state, (long_ago, long_ago))
    project.run()  # which uses the second one
    project.write({"loop": SOURCES["loop"].replace("1000", "3000")})
    project.run()
    assert not first.exists()
    assert len([*project.cache.glob("project.loop-*")]) == 2


def test_without_a_folder_that_can_be_written_the_user_s_is_taken_or_none(project, tmp_path):
    """A file stands where a folder is wanted."""
    (tmp_path / "file").write_text("")
    wrong, user = str(tmp_path / "file"), tmp_path / "user"
    given = {"NUMBA_CACHE_DIR": wrong, "XDG_CACHE_HOME": str(user)}
    assert project.run(**given) == (FOUND, 0)
    assert project.run(**given) == (FOUND, 1)
    assert len([*(user / "fastac" / "loops").iterdir()]) == 3
    assert project.run(**given | {"XDG_CACHE_HOME": wrong}) == (FOUND, 0)
    assert project.run(**given | {"XDG_CACHE_HOME": wrong}) == (FOUND, 0)


def test_nothing_is_kept_of_files_that_were_written_since_the_process_began(project):
    """It may run what they held before."""
    soon = time.time() + 1000
    os.utime(project.folder / "project" / "seventh.py", (soon, soon))
    assert project.run() == (FOUND, 0)
    assert project.run() == (FOUND, 0)
    assert project.states() == ["project.middle", "project.parts"]


def test_a_loop_without_a_file_is_compiled_all_the_same():
    code = "from fastac.store.compiled_loops import compiled; print(compiled()(lambda x: x + 1)(2))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "3\n"


ROOT = Path(compiled_loops.__file__).resolve().parents[2]


@pytest.mark.parametrize("folder", ["models", "sensor", "scenes", "fastac/store"])
def test_all_imports_of_the_project_at_the_top_of_its_files_are_seen(folder):
    for path in (ROOT / folder).rglob("*.py"):
        text, known = path.read_text(), set()
        for node in ast.parse(text).body:
            match node:
                case ast.ImportFrom():
                    assert node.level == 0, path
                    known |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                case ast.Import():
                    known |= {alias.name for alias in node.names}
                case ast.Try() | ast.With() | ast.For():
                    inner = [n.module for n in ast.walk(node) if isinstance(n, ast.ImportFrom)]
                    assert not any(name.startswith("fastac") for name in inner), path
        assert known <= {*compiled_loops.imports_at_top(text)}, path


def test_loops_may_be_made_in_several_threads(tmp_path, monkeypatch):
    """What Numba is told of the folder is there for each loop alone."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    loops = []

    def make():
        loops.extend(compiled()(lambda x: x + 1) for _ in range(20))

    threads = [threading.Thread(target=make) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert str(tmp_path) == config.CACHE_DIR
    assert len(loops) == 80
    assert loops[0](np.int64(2)) == 3
