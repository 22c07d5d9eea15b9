"""A run: frames of a source through the hardware, results to the terminal and to files as they come."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from types import FrameType
from typing import TypeVar

from fastac.driver.driver import Driver
from fastac.driver.live import Live
from fastac.driver.recorder import Recorder
from fastac.driver.sources import Source


class Stop:
    """Ctrl-C and SIGTERM ask for an end instead of interrupting: no further frame is sent, and what is in
    flight is waited for. A second Ctrl-C interrupts as ever."""

    def __init__(self):
        self.asked = False
        self._before: dict[int, Callable | int | None] = {}

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def __enter__(self) -> "Stop":
        if threading.current_thread() is threading.main_thread():  # only there may handlers be set
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *error) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


T = TypeVar("T")


def until_stopped(frames: Iterable[T], stop: Stop) -> Iterator[T]:
    """The frames until an end is asked for."""
    for frame in frames:
        if stop.asked:
            return
        yield frame


def run(
    driver: Driver,
    source: Source,
    recorders: Sequence[Recorder],
    live: Live,
    *,
    frames: int | None = None,
    batch: int | None = None,
) -> bool:
    """Send frames until the source ends, `frames` have gone in, or Ctrl-C; whether it was Ctrl-C.

    batch : frames that may be in flight; None: one for a live source, else as many as the transport holds
    """
    with Stop() as stop:
        chosen = until_stopped(islice(source.frames, frames), stop)
        try:
            for found in driver.frames(chosen, in_flight=batch or (1 if source.live else None)):
                live.add(found)
                for recorder in recorders:
                    recorder.add(found)
        finally:
            live.close()
            for recorder in recorders:
                recorder.close()
        return stop.asked
