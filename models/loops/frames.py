"""Frames processed in parallel: many in chunks, one thread each; few by all threads together."""

import threading
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from fastac.models.loops.team import threads, together
from fastac.store.progress import progress_bar

CHUNK = 16
"""Frames per call of a worker; bounds the memory."""

Outputs = dict[str, tuple[tuple[int, ...], type]]
"""For each output, by name, its shape for one frame and its element type."""


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def choose_outputs(outputs: Outputs, wanted: Iterable[str] | None) -> Outputs:
    """The outputs named in `wanted`, or all for None; raises ValueError for an unknown name."""
    if wanted is None:
        return outputs
    for name in (wanted := tuple(wanted)):
        if name not in outputs:
            raise ValueError(f"wanted {name!r}: expected some of {', '.join(outputs)}")
    return {name: outputs[name] for name in wanted}


def require_frames(frames: np.ndarray, background: np.ndarray) -> None:
    """Raise ValueError unless frames are (frames, H, W, C) uint8, with the background's H, W and C."""
    if frames.shape[1:] != background.shape or frames.dtype != np.uint8:
        raise ValueError(f"frames {frames.shape} {frames.dtype}: expected {background.shape} uint8 each")


class IdleWorkers:
    """Workers that have done their work, kept for the next frames: their scratch memory takes time to
    make."""

    def __init__(self):
        self._kept: dict[frozenset[str], deque[Callable]] = defaultdict(deque)

    @contextmanager
    def lent(
        self, make: Callable[[frozenset[str]], Callable], outputs: frozenset[str]
    ) -> Iterator[Callable[[], Callable]]:
        """What gives workers for some outputs, kept ones first; it takes them back in the end.

        Any number of threads may have workers at once.
        """
        kept, lent = self._kept[outputs], []

        def worker() -> Callable:
            try:
                found = kept.pop()
            except IndexError:
                found = make(outputs)
            lent.append(found)
            return found

        yield worker
        kept.extend(lent)  # not after an error, which may have left one at work


def over_frames(
    worker: Callable[[], Callable],
    frames: np.ndarray,
    outputs: Outputs,
    *,
    progress: bool,
    label: str,
) -> dict[str, np.ndarray]:
    """Process frames; returns an array (frames, …) for each of `outputs`.

    worker : called once in each thread, and returns the function that processes a chunk; that function may
        own scratch memory. It is called with a chunk of frames and, by name, the views of the result arrays
        that it fills. Where it has an attribute `can_share` that is true, it can be given a number of threads
        as well, which process each frame together.
    label : name of the progress bar
    Threads run in parallel because NumPy, torch and compiled loops release the interpreter's lock; where
    frames are not shared, BLAS is limited to one thread in each. Raises ValueError without frames.
    """
    if not len(frames):
        raise ValueError("frames: none to process")
    found = {name: np.empty((len(frames), *shape), kind) for name, (shape, kind) in outputs.items()}
    count, own = threads(), worker()
    shares = getattr(own, "can_share", False)
    if shares and (len(frames) == 1 or len(frames) < count):
        own(frames, found, count)  # as little as possible besides, for each frame of a stream comes alone
        return found
    # What is left over after all threads have had as many is shared, so that none is idle meanwhile.
    rest = len(frames) % count if shares else 0
    whole = len(frames) - rest
    with (
        progress_bar(total=len(frames), desc=label, unit="frame", enabled=progress) as bar,
        nullcontext() if shares else _blas().limit(limits=1, user_api="blas"),
    ):
        _Batch(worker, frames[:whole], found, bar.update).run(own, min(count, whole))
        if rest:
            own(frames[whole:], {name: array[whole:] for name, array in found.items()}, count)
            bar.update(rest)
    return found


class _Batch:
    """Frames that threads take chunk by chunk."""

    def __init__(
        self,
        worker: Callable[[], Callable],
        frames: np.ndarray,
        found: dict[str, np.ndarray],
        told: Callable[[int], object],
    ):
        self.worker, self.frames, self.found, self.told = worker, frames, found, told
        self.next, self.busy, self.error = 0, 0, None
        self.changed = threading.Condition()

    def run(self, own: Callable, count: int) -> None:
        """In this thread with the worker `own`, and in others; raises what goes wrong in any."""
        self.step = min(CHUNK, -(-len(self.frames) // count))

        def part(member: int) -> None:
            self._chunks(own if member == 0 else None)

        try:
            together(part, count)
        finally:
            with self.changed:
                self.next = len(self.frames)  # so that nothing is begun after an interruption
                self.changed.wait_for(lambda: not self.busy)
        if self.error is not None:
            raise self.error

    def _chunks(self, work: Callable | None) -> None:
        while (start := self._begin()) is not None:
            try:
                work = work or self.worker()
                part = slice(start, min(start + self.step, len(self.frames)))
                work(self.frames[part], {name: array[part] for name, array in self.found.items()})
                self._end(part.stop - start)
            except BaseException as error:
                self._end(error)
                raise

    def _begin(self) -> int | None:
        """The first frame of the next chunk, if there is one."""
        with self.changed:
            start = self.next
            if start >= len(self.frames):
                return None
            self.next, self.busy = start + self.step, self.busy + 1
            return start

    def _end(self, result: int | BaseException) -> None:
        """Of a chunk: its number of frames, or an error, after which no other is begun."""
        with self.changed:
            self.busy -= 1
            if isinstance(result, BaseException):
                self.next, self.error = len(self.frames), self.error or result
            else:
                self.told(result)
            self.changed.notify_all()
