"""A stream from its session into its sinks, until it ends or an end is asked for."""

import time
from collections.abc import Sequence
from contextlib import ExitStack

from fastac.driver.live import StatusLine
from fastac.driver.run import Stop
from fastac.streaming.server import Publisher
from fastac.streaming.session import Session
from fastac.streaming.sink import Sink

LOOK_S = 0.02
"""Between two looks at who has come."""


def await_readers(publisher: Publisher, count: int, stop: Stop, *, progress: bool) -> None:
    """Wait until `count` readers take records, or an end is asked for."""
    line = StatusLine(enabled=progress)
    while publisher.subscribers < count and not stop.asked:
        line.show(lambda: f"waiting for readers: {publisher.subscribers} of {count} are here")
        time.sleep(LOOK_S)
    line.close()


def pump(
    session: Session,
    sinks: Sequence[Sink],
    *,
    frames: int | None = None,
    in_flight: int | None = None,
    stop: Stop | None = None,
) -> bool:
    """Give every record to each sink in turn, and close the sinks at the end.

    frames, in_flight : as of `Session.records`
    stop : what asks for an early end; None: Ctrl-C and SIGTERM do. No further frame is sent then, and the
        records of those in flight are still given to the sinks.

    Returns whether an early end was asked for.

    A sink that fails ends the stream; the others are closed all the same, and its error is raised.
    """
    with ExitStack() as stack:
        stop = stop or stack.enter_context(Stop())
        for sink in reversed(sinks):
            stack.callback(sink.close)
        for record in session.records(frames=frames, in_flight=in_flight, stop=stop):
            for sink in sinks:
                sink.add(record)
    return stop.asked
