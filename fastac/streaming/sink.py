"""What takes the records of a stream: a socket, a file, a view."""

from typing import Protocol

from fastac.streaming.record import StreamRecord


class Sink(Protocol):
    """Takes records one after another, and is closed at the end.

    A sink that keeps a log takes every record, and may make the stream wait for it. A sink that shows or
    sends may leave records out when it cannot keep up, and counts those.
    """

    def add(self, record: StreamRecord) -> None: ...

    def close(self) -> None: ...
