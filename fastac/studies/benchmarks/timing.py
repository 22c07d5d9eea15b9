"""Timing of a function: the fastest of several runs."""

import time
from collections.abc import Callable

PAUSE_S = 0.1
"""Pause before each run, since schedulers of shared machines favour processes that have been idle."""


def fastest(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Minimum wall-clock and minimum processor time in s over `repeats` runs: disturbances only add time."""
    clocks = []
    for _ in range(repeats):
        time.sleep(PAUSE_S)
        start, busy = time.perf_counter(), time.process_time()
        run()
        clocks.append((time.perf_counter() - start, time.process_time() - busy))
    wall, processor = zip(*clocks, strict=True)
    return min(wall), min(processor)
