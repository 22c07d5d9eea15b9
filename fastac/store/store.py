"""The store: performs steps, keeps their results, and hands out those that are current."""

import math
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from filelock import FileLock, Timeout

from fastac.store import entries, traces
from fastac.store.closure import Code
from fastac.store.entries import Entry
from fastac.store.files import write_json
from fastac.store.recording import Recording, recording, unrecorded
from fastac.store.steps import VALUE, Step, StepError, assembled, needed_steps
from fastac.store.traces import Inputs

Announce = Callable[[str, str], None]
"""Called with a step's name and its state: kept, running, waiting."""
DAY_S = 86400
CHECKPOINTS = ".checkpoints"
"""In the store's folder: what interrupted steps go on from, see `checkpoint.py`."""


def _silent(name: str, state: str) -> None:
    pass


class Store:
    """A folder of results, `<step>/<bucket>-<number>/`, that many processes may use at once.

    What belongs to one set of arguments shares a bucket and its lock. A result appears whole, by renaming a
    folder of `.part`; whoever holds the bucket's lock may clear there what a killed process has left.
    """

    def __init__(self, folder: Path, code: Code | None = None):
        self.folder = Path(folder).absolute()
        self.code = code or Code()
        self._read: dict[Path, Entry] = {}

    def perform(
        self, step: Step, announce: Announce | None = None, performed: dict[Step, Entry] | None = None
    ) -> Entry:
        """The step's current result, performed first if there is none. What it raises passes through.

        performed : results that need not be looked up again; those of this call are added
        """
        announce = announce or _silent
        performed = {} if performed is None else performed
        if step not in performed:
            needed = {other: self.perform(other, announce, performed) for other in needed_steps(step)}
            performed[step] = self._perform(step, needed, announce)
        return performed[step]

    def _perform(self, step: Step, needed: Mapping[Step, Entry], announce: Announce) -> Entry:
        inputs = Inputs.of(step, needed)
        self.code.refresh()
        entry = self._kept(inputs)
        if entry is None:
            with self._locked(inputs.run, lambda: announce(step.name, "waiting")):
                entry = self._kept(inputs)
                if entry is None:
                    announce(step.name, "running")
                    entry = self._run(inputs)
                    inputs.include(entry)
                    return entry
        announce(step.name, "kept")
        inputs.include(entry)
        return entry

    def latest(self, step: Step) -> Entry | None:
        """The entry used last of all steps of this name and function, whatever they were given."""
        found = self._candidates(step.name, "*")
        return next((entry for entry in found if entry.trace["function"] == step.code), None)

    def value(self, step: Step, announce: Announce | None = None) -> object:
        """The result of a step without outputs; tuples have become lists."""
        if step.outputs:
            raise StepError(f"step {step.name}: has outputs, no value")
        return self.perform(step, announce).value

    def is_current(self, step: Step) -> bool:
        """Whether the step and all that it needs have been performed and nothing that counts changed."""
        return self._look(step)[0] is not None

    def why(self, step: Step) -> str:
        """One line that names what would make the step run, or says that nothing does."""
        return self._look(step)[1]

    def verify(self) -> list[str]:
        """Compare all outputs with their digests; names of damaged entries, which are removed."""
        damaged = []
        for folder in self._entries():
            entry = entries.read(folder)
            damage = entry.verify() if entry else "no trace"
            if damage:
                damaged.append(f"{folder.parent.name}/{folder.name}: {damage}")
                self._remove(folder)
        return damaged

    def clean(self, keep_days: float) -> list[str]:
        """Remove entries that were not used for so many days, at least one; names of what was removed.

        One that is used touches its trace, so those that a running process works with stay.
        """
        if keep_days < 1:
            raise ValueError(f"keep_days = {keep_days}: running processes may need what was used today")
        oldest, removed = time.time() - keep_days * DAY_S, []
        for folder in self._entries():
            with suppress(FileNotFoundError):  # another process cleans as well
                used = os.stat(folder / entries.TRACE).st_mtime
                if used < oldest and self._remove(folder, oldest):
                    removed.append(f"{folder.parent.name}/{folder.name}")
        for file in (self.folder / CHECKPOINTS).glob("*"):
            if file.stat().st_mtime < oldest:
                file.unlink(missing_ok=True)
        self._sweep()
        return removed

    def _look(self, step: Step) -> tuple[Entry | None, str]:
        """The current entry, if there is one, and what to say about it; performs nothing."""
        upstream = {}
        for other in needed_steps(step):
            entry, reason = self._look(other)
            if entry is None:
                return None, reason if reason.startswith("needs ") else f"needs {other.name}: {reason}"
            upstream[other] = entry
        inputs = Inputs.of(step, upstream)
        self.code.refresh()
        entry = self._current(inputs)
        if entry is not None:
            return entry, "current"
        for candidate in self._candidates(step.name, f"{inputs.bucket}-*"):
            with unrecorded():
                reasons = list(traces.differences(candidate, inputs, self.code, self.folder))
            if not reasons:  # performed elsewhere since the line above
                return candidate, "current"
            return None, _one_line(reasons)
        for candidate in self._candidates(step.name, "*"):
            return None, next(traces.arguments_changed(candidate.trace, inputs))
        return None, "never performed"

    def _current(self, inputs: Inputs) -> Entry | None:
        with unrecorded():
            for entry in self._candidates(inputs.step.name, f"{inputs.bucket}-*"):
                if next(traces.differences(entry, inputs, self.code, self.folder), None) is None:
                    return entry
        return None

    def _candidates(self, name: str, pattern: str) -> Iterator[Entry]:
        """Entries, those used last first."""
        found = []
        for folder in (self.folder / name).glob(pattern):
            entry = self._read.get(folder) or entries.read(folder)
            try:
                used = os.stat(folder / entries.TRACE).st_mtime_ns
            except FileNotFoundError:  # another process has removed it
                self._read.pop(folder, None)
                continue
            if entry is not None:
                self._read[folder] = entry
                found.append((used, entry.id, entry))
        return (entry for *_, entry in sorted(found, reverse=True))

    def _kept(self, inputs: Inputs) -> Entry | None:
        """The current entry, marked as used together with those of the steps inside it."""
        entry = self._current(inputs)
        try:
            for used in (entry.folder, *map(self.folder.joinpath, entry.trace["inner"])) if entry else ():
                os.utime(used / entries.TRACE)
        except FileNotFoundError:  # removed in this moment as long unused
            return None
        return entry

    def _run(self, inputs: Inputs) -> Entry:
        """Perform a step whose run is locked; other settings of the same bucket may run meanwhile."""
        step = inputs.step
        with self._locked(inputs.bucket, lambda: None):
            self._discard_damaged(inputs)
        self.code.loaded(step.code)
        part = self.folder / ".part" / inputs.run
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        try:
            began = time.perf_counter()
            with recording() as record:
                result = step.function(part, **_arguments(inputs, record), **step.unkeyed)
            seconds = time.perf_counter() - began
            if not step.outputs:
                write_json(part / VALUE, result)
            outputs = entries.seal(part, step)
            self.code.refresh()
            write_json(part / entries.TRACE, traces.make(inputs, record, self.code, outputs, seconds))
            final = self.folder / step.name / f"{inputs.bucket}-{secrets.token_hex(4)}"
            final.parent.mkdir(exist_ok=True)
            os.replace(part, final)
        finally:
            shutil.rmtree(part, ignore_errors=True)
        return entries.read(final)

    def _discard_damaged(self, inputs: Inputs) -> None:
        for folder in (self.folder / inputs.step.name).glob(f"{inputs.bucket}-*"):
            entry = entries.read(folder)
            if entry is None or entry.damage():
                self._throw_away(folder)

    def _remove(self, folder: Path, oldest: float = math.inf) -> bool:
        """Remove an entry unless its bucket is in use or it was used since `oldest`."""
        try:
            with FileLock(self._lock_file(folder.name.partition("-")[0]), timeout=0):
                return self._throw_away(folder, oldest)
        except Timeout:
            return False

    def _throw_away(self, folder: Path, oldest: float = math.inf) -> bool:
        """Remove an entry at once, so that nobody finds half of it."""
        trash = self.folder / ".part" / folder.name
        trash.parent.mkdir(exist_ok=True)
        os.replace(folder, trash)
        trace = trash / entries.TRACE
        if trace.exists() and trace.stat().st_mtime > oldest:
            os.replace(trash, folder)  # used after it was chosen for removal, without the lock
            return False
        shutil.rmtree(trash, ignore_errors=True)
        return True

    def _sweep(self) -> None:
        """Clear what killed processes have left."""
        for part in (self.folder / ".part").glob("*"):
            try:
                with FileLock(self._lock_file(part.name.partition("-")[0]), timeout=0):
                    shutil.rmtree(part, ignore_errors=True)
            except Timeout:
                continue

    def _entries(self) -> Iterator[Path]:
        return (folder for folder in self.folder.glob("[!.]*/*-*") if folder.is_dir())

    def _lock_file(self, bucket: str) -> Path:
        locks = self.folder / ".locks"
        locks.mkdir(parents=True, exist_ok=True)
        return locks / f"{bucket}.lock"

    @contextmanager
    def _locked(self, bucket: str, waiting: Callable[[], None]) -> Iterator[None]:
        lock = FileLock(self._lock_file(bucket))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            waiting()
            lock.acquire()
        try:
            yield
        finally:
            lock.release()


def _arguments(inputs: Inputs, record: Recording) -> dict[str, object]:
    """What the function is given: settings that tell `record` what is read."""

    def reader(place: str) -> Callable[[str, object], None]:
        return lambda path, value: record.read(place, path, value)

    watched = {place: settings.watched(reader(place)) for place, settings in inputs.settings.items()}
    given = inputs.given | watched
    return {name: assembled(value, name, given) for name, value in inputs.step.arguments.items()}


def _one_line(reasons: Sequence[str]) -> str:
    """The first reason, and how many follow."""
    first, *others = reasons
    others = [reason for reason in others if reason != "code changed"]
    return f"{first} (and {len(others)} more)" if others else first


def open_store(folder: Path) -> Store:
    """The store in a folder; within a process always the same, so that code is read once."""
    return _store(Path(folder).absolute())


@cache
def _store(folder: Path) -> Store:
    return Store(folder, _code())


@cache
def _code() -> Code:
    return Code()
