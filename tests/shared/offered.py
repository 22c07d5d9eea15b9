"""A stream that is offered to readers while a test runs."""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord
from fastac.streaming.server import Publisher

PATIENCE_S = 30.0


@contextmanager
def offered(about: About, records: Sequence[StreamRecord], *, ends: bool = True) -> Iterator[str]:
    """Offer the records as soon as somebody listens; gives the address.

    ends : whether the stream ends after them, or stays silent as long as the context lasts
    """
    publisher = Publisher("tcp://127.0.0.1:*")
    publisher.announce(about)

    def run() -> None:
        until = time.monotonic() + PATIENCE_S
        while not publisher.subscribers and time.monotonic() < until:
            time.sleep(0.01)
        for record in records:
            publisher.add(record)
        if ends:
            publisher.close()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield publisher.address
    finally:
        thread.join()
        publisher.close()
