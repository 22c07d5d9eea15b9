"""Views at work beside the stream: each has a thread of its own, and a rule for what it cannot keep up with.

A view that shows takes the newest record and leaves out those that came meanwhile: the stream never waits.
A view that keeps a log takes every record: the stream waits for it where it is slower.
"""

import threading
import time
from collections import deque
from collections.abc import Callable

from fastac.streaming.record import StreamRecord

Take = Callable[[StreamRecord, int], None]
"""Takes a record, and how many were left out before it since the last one."""
LOG_RECORDS = 64
"""Records that may wait for a log before the stream waits too."""


class _Worker:
    """A sink whose records a thread hands to `take`; errors there are raised at the next `add` or at the end.

    waiting : records that may wait; None: the newest alone, and older ones are left out
    rest_s : least time between the beginnings of two calls of `take`
    """

    def __init__(self, take: Take, done: Callable[[], None], waiting: int | None, rest_s: float = 0.0):
        self.taken = self.left_out = 0
        self._take, self._done, self._limit, self._rest_s = take, done, waiting, rest_s
        self._records: deque[tuple[StreamRecord, int]] = deque()
        self._changed = threading.Condition()
        self._closed = self._told = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def add(self, record: StreamRecord) -> None:
        """Hand a record to the view. Raises what the view has raised."""
        with self._changed:
            skipped = 0
            if self._limit is None:
                if self._records:
                    skipped = self._records.pop()[1] + 1
                    self.left_out += 1
            else:
                self._changed.wait_for(lambda: len(self._records) < self._limit or self._error)
            self._raise()
            self._records.append((record, skipped))
            self._changed.notify_all()

    def close(self) -> None:
        """Wait until the view has what still waits, and end it. Raises what the view has raised."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()
        if not self._told:
            self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            self._told = True
            raise self._error

    def _work(self) -> None:
        try:
            while (taken := self._next()) is not None:
                begun = time.monotonic()
                self._take(*taken)
                self.taken += 1
                if (rest := begun + self._rest_s - time.monotonic()) > 0 and not self._closed:
                    time.sleep(rest)
        except Exception as error:
            self._fail(error)
        try:
            self._done()
        except Exception as error:
            self._fail(error)

    def _next(self) -> tuple[StreamRecord, int] | None:
        """The record to take and how many were left out before it; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._records or self._closed)
            if not self._records:
                return None
            taken = self._records.popleft()
            self._changed.notify_all()
            return taken

    def _fail(self, error: Exception) -> None:
        with self._changed:
            self._error = self._error or error
            self._changed.notify_all()


class Newest(_Worker):
    """A sink that shows: `show` gets the newest record, at most `per_second` of them.

    taken, left_out : how many records have been shown, and how many have not
    """

    def __init__(self, show: Take, *, per_second: float, done: Callable[[], None] = lambda: None):
        super().__init__(show, done, None, 1 / per_second)


class Every(_Worker):
    """A sink that keeps a log: `take` gets every record; `add` waits while many are on their way to it."""

    def __init__(self, take: Take, *, done: Callable[[], None] = lambda: None, waiting: int = LOG_RECORDS):
        super().__init__(take, done, waiting)
