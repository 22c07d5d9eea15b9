"""What a step looks up while it runs, and for whom it is recorded.

The thread that performs a step records for this step and for those around it. A thread that performs none is
taken for a worker of every step that is running: too much may be recorded then, never too little. Child
processes record nothing: a step hands them plain values that it has read itself.
"""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from fastac.store.digest import encoded


@dataclass
class Recording:
    """Everything that one run of a step has read."""

    reads: dict[str, dict[str, object]] = field(default_factory=dict)
    """By argument and path: the settings' values."""
    codes: set[str] = field(default_factory=set)
    """Functions and classes that ran without being in the function's own code."""
    entries: dict[str, set[str]] = field(default_factory=dict)
    """By table of kinds: the names that were looked up."""
    names: dict[str, list[str]] = field(default_factory=dict)
    """By table of kinds: all its names, where they were listed."""
    paths: dict[str, str] = field(default_factory=dict)
    """Digest by path: the files that steps inside this one were given."""
    inner: dict[str, Mapping[str, str]] = field(default_factory=dict)
    """Digests of outputs by entry: steps performed inside this one."""
    lock: threading.Lock = field(default_factory=threading.Lock)

    def read(self, argument: str, path: str, value: object) -> None:
        """What watched settings call: a value, or a class whose code may run unwatched."""
        with self.lock:
            if isinstance(value, type):
                self.codes.add(f"{value.__module__}:{value.__qualname__}")
            else:
                self.reads.setdefault(argument, {})[path] = encoded(value)


_lock = threading.Lock()
_running: list[Recording] = []
_own: ContextVar[tuple[Recording, ...]] = ContextVar("_own", default=())


def recordings() -> tuple[Recording, ...]:
    """All that what happens in this thread belongs to."""
    own = _own.get()
    if own or not _running:
        return own
    with _lock:
        return tuple(_running)


@contextmanager
def recording() -> Iterator[Recording]:
    new = Recording()
    token = _own.set((*recordings(), new))
    with _lock:
        _running.append(new)
    try:
        yield new
    finally:
        with _lock:
            _running[:] = [other for other in _running if other is not new]
        _own.reset(token)


@contextmanager
def unrecorded() -> Iterator[None]:
    """Look-ups inside belong to no step around it: the engine's own, or a step in a thread of its own."""
    token = _own.set((Recording(),))
    try:
        yield
    finally:
        _own.reset(token)


def looked_up(table: str, name: str) -> None:
    for each in recordings():
        with each.lock:
            each.entries.setdefault(table, set()).add(name)


def listed(table: str, names: list[str]) -> None:
    for each in recordings():
        with each.lock:
            each.names[table] = names
