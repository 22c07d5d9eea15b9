"""A stream's records out of another process, or from another machine.

from fastac.streaming.client import connect

with connect("tcp://127.0.0.1:5599") as stream:
    print(stream.about.force_axes)
    for record in stream:
        print(record.frame, record.force_n)

This module needs NumPy and pyzmq and nothing else, and imports quickly.
"""

import time
from concurrent.futures import Future, ThreadPoolExecutor

from fastac.streaming import about as descriptions
from fastac.streaming import end
from fastac.streaming import record as records
from fastac.streaming.about import About
from fastac.streaming.address import DEFAULT_ADDRESS
from fastac.streaming.messages import Messages, Newest, Parts, StreamError
from fastac.streaming.record import StreamRecord

TIMEOUT_S = 5.0


class Stream:
    """The records that a server publishes, from the next one on; `connect` makes it.

    about : the stream's description
    received : records so far
    missed : frames between the first record and the latest, or the stream's end, whose records did not come:
        the server left them out because this reader was slow, or `latest` skipped them

    Iterating ends where the stream does. It raises StreamError where the server is gone before that, and
    RecordError for a damaged message, after which one may go on. `async for` does the same without blocking
    the event loop.
    """

    about: About

    def __init__(self, address: str, *, latest: bool, timeout_s: float):
        self.received = self.missed = 0
        self._expected: int | None = None
        self._is_over = False
        self._thread: ThreadPoolExecutor | None = None
        self._coming: Future | None = None
        messages = Messages(address)
        try:
            self.about = _description(messages, timeout_s)
        except BaseException:
            messages.close()
            raise
        self._messages = Newest(messages) if latest else messages

    def __enter__(self) -> "Stream":
        return self

    def __exit__(self, *error) -> None:
        self.close()

    def close(self) -> None:
        """Release the connection."""
        self._is_over = True
        self._messages.stop()
        if self._thread is not None:
            self._thread.shutdown()
        self._messages.close()

    def __iter__(self) -> "Stream":
        return self

    def __next__(self) -> StreamRecord:
        while not self._is_over:
            parts = self._messages.next()
            if parts is None or parts[0] == end.TOPIC:
                self._finish(parts)
            elif parts[0] != descriptions.TOPIC:  # which comes again whenever there is another reader
                return self._record(parts)
        raise StopIteration

    def _finish(self, parts: Parts | None) -> None:
        self._is_over = True
        if parts is not None and self._expected is not None:
            self.missed += max(0, end.decode(parts).frames - self._expected)

    def _record(self, parts: Parts) -> StreamRecord:
        found = records.decode(parts)
        if self._expected is not None:
            self.missed += max(0, found.frame - self._expected)
        self._expected = found.frame + 1
        self.received += 1
        return found

    def __aiter__(self) -> "Stream":
        return self

    async def __anext__(self) -> StreamRecord:
        import asyncio  # takes as long as all the rest of this module

        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="fastac-stream")
        if self._coming is None:  # else an earlier wait for it was cancelled
            self._coming = self._thread.submit(next, self, None)
        coming = self._coming
        try:
            found = await asyncio.shield(asyncio.wrap_future(coming))
        finally:
            if coming.done():
                self._coming = None
        if found is None:
            raise StopAsyncIteration
        return found


def connect(address: str = DEFAULT_ADDRESS, *, latest: bool = False, timeout_s: float = TIMEOUT_S) -> Stream:
    """The stream that is published at an address, as a context manager.

    latest : always give the newest record, and skip those that came meanwhile; else give all in order
    timeout_s : how long to wait for the stream's description
    Raises StreamError or AboutError, one line, where no stream answers in time.
    """
    return Stream(address, latest=latest, timeout_s=timeout_s)


def _description(messages: Messages, timeout_s: float) -> About:
    """The description, which comes first. Records that come before it are of frames before this reader's."""
    deadline = time.monotonic() + timeout_s
    while (parts := messages.next(deadline - time.monotonic())) is not None:
        if parts[0] == descriptions.TOPIC:
            return descriptions.decode(parts)
        if parts[0] == end.TOPIC:
            raise StreamError(f"{messages.address}: the stream has just ended")
    raise StreamError(
        f"{messages.address}: no stream within {timeout_s:g} s; is `fastac serve` running there?"
    )
