"""Threads that live as long as the process and take part in what others have begun.

A thread that is woken needs some 20 µs, one that must first be made several times as much: nothing to a batch
of frames, but a part of the time that one frame takes.
"""

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue

CORES = os.cpu_count() or 1


def threads() -> int:
    """Number of threads: OMP_NUM_THREADS if it is set, as for BLAS, otherwise one per core."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return int(stated) if stated.isdecimal() and int(stated) else CORES


class _Helper:
    """A thread that does one after another what it is offered."""

    def __init__(self, number: int):
        self.offers: SimpleQueue[Callable[[], object]] = SimpleQueue()
        threading.Thread(target=self._help, name=f"fastac-{number}", daemon=True).start()

    def _help(self) -> None:
        while True:
            work = self.offers.get()
            with suppress(Exception):  # what fails here fails for the caller too, who is told
                work()
            del work  # and with it what it holds, before the next is waited for


_helpers: list[_Helper] = []
_growing = threading.Lock()


def _make_helpers(count: int) -> None:
    with _growing:
        while len(_helpers) < count:
            _helpers.append(_Helper(len(_helpers) + 1))


def _forget_helpers() -> None:
    """In a forked process, where only the thread that forked is left."""
    global _growing
    _helpers.clear()
    _growing = threading.Lock()


os.register_at_fork(after_in_child=_forget_helpers)


def together(work: Callable[[int], object], count: int) -> None:
    """Call work(0) in this thread, and work(1) … work(count − 1) in others, the same ones each time; returns
    when this thread's call returns.

    The calls share tasks as in `loops/tasks.py`, so that it does not matter whether others are there, or
    when. A call that begins late must find nothing left to do. Only the exceptions of this thread's call are
    raised.
    """
    if len(_helpers) < count - 1:
        _make_helpers(count - 1)
    for member in range(1, count):
        _helpers[member - 1].offers.put(partial(work, member))
    work(0)
