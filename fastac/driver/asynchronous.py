"""The driver in an asyncio program: frames from any iterable, also an asynchronous one."""

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from fastac.driver.driver import Driver
from fastac.driver.packets import Found


async def frames(
    driver: Driver,
    source: Iterable[np.ndarray] | AsyncIterable[np.ndarray],
    *,
    in_flight: int | None = None,
) -> AsyncIterator[Found]:
    """As `Driver.frames`, which runs in a thread of its own, so that the event loop is never blocked.

    >>> async for found in frames(driver, camera, in_flight=1):
    ...     print(found.force_n)
    """
    loop = asyncio.get_running_loop()
    bridge = _Bridge(source, loop) if isinstance(source, AsyncIterable) else None
    results = driver.frames(bridge or source, in_flight=in_flight)
    with ThreadPoolExecutor(1, thread_name_prefix="fastac-driver") as thread:
        try:
            while (found := await loop.run_in_executor(thread, next, results, None)) is not None:
                yield found
        finally:
            if bridge is not None:
                bridge.cancel()
            await asyncio.shield(loop.run_in_executor(thread, results.close))


class _Bridge:
    """An asynchronous source for a thread: each frame is awaited in the event loop."""

    def __init__(self, source: AsyncIterable[np.ndarray], loop: asyncio.AbstractEventLoop):
        self._source, self._loop = aiter(source), loop
        self._awaited = None
        self._cancelled = False

    def __iter__(self) -> Iterator[np.ndarray]:
        while not self._cancelled:
            self._awaited = asyncio.run_coroutine_threadsafe(self._following(), self._loop)
            frame = self._awaited.result()
            if frame is None:
                return
            yield frame

    async def _following(self) -> np.ndarray | None:
        return await anext(self._source, None)

    def cancel(self) -> None:
        """Wake the thread up, should it wait for a frame."""
        self._cancelled = True
        if self._awaited is not None:
            self._awaited.cancel()
