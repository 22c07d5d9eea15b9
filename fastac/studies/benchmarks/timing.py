"""The fastest of several runs."""

import time
from collections.abc import Callable

PAUSE_S = 0.1
"""Before each run: a machine that is shared gives its cores rather to who has not just used them."""


def fastest(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Seconds of wall clock and of processor time, of the fastest run each: noise only ever adds."""
    clocks = []
    for _ in range(repeats):
        time.sleep(PAUSE_S)
        start, busy = time.perf_counter(), time.process_time()
        run()
        clocks.append((time.perf_counter() - start, time.process_time() - busy))
    wall, processor = zip(*clocks, strict=True)
    return min(wall), min(processor)
