"""Timing of a function: the fastest of several runs."""

import time
from collections.abc import Callable, Sequence

PAUSE_S = 0.1
"""Pause before each run, since schedulers of shared machines favour processes that have been idle."""


def fastest(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Minimum wall-clock and minimum processor time in s over `repeats` runs: disturbances only add time."""
    return fastest_each([run], repeats)[0]


def fastest_each(runs: Sequence[Callable[[], object]], repeats: int) -> list[tuple[float, float]]:
    """`fastest` of several functions, which take turns: what disturbs one for long disturbs all."""
    clocks: list[list[tuple[float, float]]] = [[] for _ in runs]
    for _ in range(repeats):
        for run, known in zip(runs, clocks, strict=True):
            time.sleep(PAUSE_S)
            start, busy = time.perf_counter(), time.process_time()
            run()
            known.append((time.perf_counter() - start, time.process_time() - busy))
    return [tuple(min(values) for values in zip(*known, strict=True)) for known in clocks]
