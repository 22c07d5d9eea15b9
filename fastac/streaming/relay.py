"""A stream that runs elsewhere into sinks here, until it ends or an end is asked for."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack

from fastac.driver.run import Stop
from fastac.streaming.client import Stream
from fastac.streaming.record import StreamRecord
from fastac.streaming.sink import Sink

LOOK_S = 0.1
"""How soon a request to end is noticed while no record comes."""


def relay(stream: Stream, sinks: Sequence[Sink], *, frames: int | None = None) -> bool:
    """Give every record that comes to each sink in turn, and close the sinks at the end.

    frames : end after so many records
    Returns whether Ctrl-C or SIGTERM asked for an early end. Raises StreamError where the server is gone
    before that, RecordError for a damaged message and what a sink raises; the sinks are closed all the same.
    """
    with ExitStack() as stack:
        stop = stack.enter_context(Stop())
        for sink in reversed(sinks):
            stack.callback(sink.close)
        asyncio.run(_give(stream, sinks, stop, frames))
    return stop.asked


async def _give(stream: Stream, sinks: Sequence[Sink], stop: Stop, frames: int | None) -> None:
    async for record in _until(stream, stop):
        for sink in sinks:
            sink.add(record)
        if stream.received == frames:
            return


async def _until(stream: Stream, stop: Stop) -> AsyncIterator[StreamRecord]:
    """The records until the stream ends or an end is asked for."""
    while not stop.asked:
        try:
            yield await asyncio.wait_for(anext(stream), LOOK_S)
        except TimeoutError:
            continue
        except StopAsyncIteration:
            return
