"""Trainings of one network that differ by their draws alone, side by side in processes; the best is kept."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.models.floating.threads import single_thread
from fastac.store.side_by_side import ended, new_processes


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a trial has found: its loss, the network's arrays and the learning curve."""

    loss: float
    arrays: dict[str, np.ndarray]
    history: list[dict]


Trial = Callable[[int, str, bool], Outcome]
"""A training, given its number from 0 on, what to add to the progress bar's label, and whether to show one.

It depends on nothing else, so that it does not matter which process performs it.
"""


def best_trial(here: Trial, elsewhere: Trial, count: int, processes: int, *, progress: bool) -> Outcome:
    """The outcome of `count` trials with the smallest loss, of equal ones the first; the same whatever the
    number of processes.

    here : performed in this process, which takes its share; elsewhere : the same for the other processes, so
        it can be pickled. What a process that is killed leaves undone is done here.
    """
    shares = [range(k, count, processes) for k in range(min(processes, count))]
    with ExitStack() as pools:
        futures: list[Future] = []
        if len(shares) > 1:
            pool = pools.enter_context(ended(new_processes(len(shares) - 1)))
            futures = [pool.submit(_outcomes, elsewhere, share, count, False) for share in shares[1:]]
        found = _outcomes(here, shares[0], count, progress)
        for share, future in zip(shares[1:], futures, strict=True):
            try:
                found |= future.result()
            except BrokenProcessPool:
                found |= _outcomes(here, share, count, progress)
    return found[min(found, key=lambda trial: (found[trial].loss, trial))]


@single_thread()
def _outcomes(perform: Trial, trials: Sequence[int], count: int, progress: bool) -> dict[int, Outcome]:
    """Of a share of `count` trials; on one core, so that sums have the same order in every process."""
    with threadpool_limits(1):
        return {trial: perform(trial, f", trial {trial + 1} of {count}", progress) for trial in trials}
