"""Bad files given to readers: each must give a result or one line, in time, and touch nothing else.

A `Reader` says how damaged files are drawn and how they are read as a user reads them. `Bench.drive` writes
one case, reads it, and says what came of it; `run_batch` draws many.
"""

import os
import shutil
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import hypothesis
from hypothesis import strategies as st

EXPECTED = (ValueError, OSError, RuntimeError)
"""What `fastac.cli.common.Group` turns into one line."""
LIMIT_S = 5.0
"""Processor time that a reader may take for one case."""
COMMAND_EVERY = 100
"""Of the refused cases every so-many-th is given to the command line too."""
KEPT = 20
"""How many failures of a batch are kept."""
OUTPUT = "out"
"""In a case's folder: where a reader that writes something writes it."""


@dataclass(frozen=True)
class Link:
    """A symbolic link in a case's folder, to a file outside it."""

    target: str


Content = bytes | Link | Callable[[Path], None]
"""What is put at a name of a case: bytes, a link, or a function that writes the file."""
Case = Mapping[str, Content]


@dataclass(frozen=True)
class Reader:
    """A reader and its damaged files.

    cases : strategy of `Case`
    read : is given the folder with a case's files; what it returns is looked at by nobody
    command : the command line that reads the same; its last line of error must be that of `read`
    count : cases of the whole campaign
    quick : cases of `make test`
    """

    name: str
    cases: st.SearchStrategy
    read: Callable[[Path], object]
    command: Callable[[Path], list] | None = None
    count: int = 20_000
    quick: int = 40


class BadEndError(AssertionError):
    """A case that ended in something else than a result or one line."""


@dataclass
class Tally:
    """What became of many cases."""

    results: int = 0
    refused: Counter = field(default_factory=Counter)
    """By the error's type."""
    failures: list[str] = field(default_factory=list)
    longest_s: float = 0.0
    commands: int = 0

    @property
    def inputs(self) -> int:
        return self.results + self.refused.total() + len(self.failures)

    def add(self, other: "Tally") -> None:
        self.results += other.results
        self.refused += other.refused
        self.failures += other.failures
        self.longest_s = max(self.longest_s, other.longest_s)
        self.commands += other.commands


class _Opened:
    """What Python opens while a case is read, outside the case's folder: files that a case could name."""

    def __init__(self):
        self.folder: str | None = None
        self.outside: list[str] = []
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple) -> None:
        # Threads that an earlier test has left read files of their own.
        if self.folder is None or threading.current_thread() is not threading.main_thread():
            return
        if event not in ("open", "os.listdir", "os.scandir"):
            return
        path = arguments[0]
        if not isinstance(path, str | bytes | os.PathLike):
            return
        path = os.path.realpath(os.fsdecode(path))
        # Code and data of installed packages are opened by imports, whatever a case contains.
        if path.startswith((self.folder, sys.prefix, sys.base_prefix, *_CODE)):
            return
        # Folders of code that an earlier test has added are listed for the versions of libraries.
        if path not in {os.path.realpath(place) for place in sys.path if place}:
            self.outside.append(path)


_CODE = (*tuple(os.path.realpath(place) for place in sys.path if place), "/proc", "/sys", "/dev", "/usr")
_opened: _Opened | None = None


def _watch() -> _Opened:
    global _opened
    _opened = _opened or _Opened()
    return _opened


@contextmanager
def _limited(enabled: bool):
    """Kill the process where the block takes more processor time than a reader may: C code cannot be stopped
    otherwise."""
    if enabled:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # for one that waits, without using the processor
        signal.setitimer(signal.ITIMER_REAL, 60 * LIMIT_S)
    try:
        yield
    finally:
        if enabled:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)


class Bench:
    """Reads cases of one reader in a folder of its own.

    kill : end the process at a case that takes too long, instead of only saying so
    """

    def __init__(self, reader: Reader, folder: Path, *, kill: bool = False):
        self.reader, self.folder, self.kill = reader, folder / "case", kill
        self.tally = Tally()

    def write(self, case: Case) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        for name, content in case.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, Link):
                path.symlink_to(content.target)
            elif callable(content):
                content(path)
            else:
                path.write_bytes(content)

    def drive(self, case: Case) -> None:
        """Write and read a case; raises BadEndError unless it ends as it should."""
        self.write(case)
        watch, began, error = _watch(), time.process_time(), None
        watch.outside.clear()
        watch.folder = str(self.folder.resolve())
        try:
            with _limited(self.kill):
                self.reader.read(self.folder)
        except EXPECTED as found:
            error = found
        except Exception as found:
            raise BadEndError(f"traceback: {type(found).__name__}: {found}") from found
        finally:
            watch.folder = None
            seconds = time.process_time() - began
            self.tally.longest_s = max(self.tally.longest_s, seconds)
        if seconds > LIMIT_S:
            raise BadEndError(f"took {seconds:.1f} s")
        if watch.outside:
            raise BadEndError(f"opened {watch.outside[0]}")
        if error is None:
            self.tally.results += 1
            return
        text = str(error)
        if "\n" in text or not text:
            raise BadEndError(f"not one line: {error!r}") from error
        if str(self.folder) not in text:
            raise BadEndError(f"names no file: {error!r}") from error
        if any("\ud800" <= character <= "\udfff" for character in text):
            raise BadEndError(f"no terminal can show it: {error!r}") from error
        left = self._left_over()
        if left:
            raise BadEndError(f"left {left[0]} behind")
        self.tally.refused[type(error).__name__] += 1
        if self.reader.command and self.tally.refused.total() % COMMAND_EVERY == 1:
            self._command()

    def _left_over(self) -> list[str]:
        """Files that a refused case has left: outputs, and temporary ones of `fastac.store.files`."""
        temporary = [path for path in self.folder.rglob(".*") if ".part" in path.name]
        found = [*temporary, *(self.folder / OUTPUT).rglob("*")]
        return [str(path.relative_to(self.folder)) for path in found if path.is_file()]

    def _command(self) -> None:
        """Give the case to the command line, which must end with one line and nothing left over."""
        from click.testing import CliRunner

        from fastac.cli.main import main

        arguments = [str(a) for a in self.reader.command(self.folder)]
        found = CliRunner().invoke(main, arguments, prog_name="fastac")
        self.tally.commands += 1
        lines = found.stderr.strip().splitlines()
        if found.exit_code != 1 or not isinstance(found.exception, SystemExit) or len(lines) != 1:
            raise BadEndError(f"{' '.join(arguments[:2])}: {found.exit_code}, {found.exception!r}, {lines}")
        if not lines[0].startswith("Error: "):
            raise BadEndError(f"command line: {lines[0]!r}")
        if self._left_over():
            raise BadEndError(f"command line left {self._left_over()[0]} behind")


def run_batch(
    reader: Reader, folder: Path, seed: int, count: int, *, kill: bool = False, keep: Path | None = None
) -> Tally:
    """Draw and read `count` cases from a seed; failures are collected, the first of them in `keep`."""
    bench = Bench(reader, folder, kill=kill)

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(reader.cases)
    def one(case):
        try:
            bench.drive(case)
        except BadEndError as error:
            bench.tally.failures.append(f"{reader.name}: {error}")
            if keep is not None and len(bench.tally.failures) <= KEPT:
                shutil.copytree(
                    bench.folder, keep / str(len(bench.tally.failures)), symlinks=True, dirs_exist_ok=True
                )

    one()
    return bench.tally


def quick(reader: Reader, folder: Path) -> None:
    """The cases of `make test`: always the same ones; Hypothesis makes a failing one small."""
    bench = Bench(reader, folder)

    @hypothesis.settings(
        max_examples=reader.quick,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(reader.cases)
    def one(case):
        bench.drive(case)

    one()
    assert bench.tally.results + bench.tally.refused.total() >= reader.quick // 2
