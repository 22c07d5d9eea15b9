"""Steps that do not need each other, performed side by side in processes."""

import multiprocessing
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import open_store


def perform_all(store: Path, steps: Sequence[Step], processes: int, *, label: str, progress: bool) -> None:
    """Perform the steps that are not current in the store in the folder `store`, each in one process.

    Their functions take an unkeyed `progress`, which is off where several processes work; one process works
    here. Inside a step, perform each of the steps afterwards, so that their results are recorded.
    """
    missing = [step for step in steps if not open_store(store).is_current(step)]
    if processes == 1 or len(missing) < 2:
        for step in missing:
            _perform(store, step)
        return
    quiet = [replace(step, unkeyed=step.unkeyed | {"progress": False}) for step in missing]
    with multiprocessing.get_context("spawn").Pool(min(processes, len(quiet))) as pool:
        done = pool.imap_unordered(partial(_perform, store), quiet)
        list(progress_bar(done, total=len(quiet), desc=label, enabled=progress))


def _perform(store: Path, step: Step) -> None:
    open_store(store).perform(step)


def new_processes(count: int) -> ProcessPoolExecutor:
    """An executor of so many processes, which end with this one, even if it is killed."""
    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, mp_context=spawn, initializer=_end_with_parent)


@contextmanager
def ended(executor: Executor) -> Iterator[Executor]:
    """The executor, which ends with the block; where that raises, tasks that wait are given up."""
    with executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """End this process when its parent ends, even if that is killed."""

    def watch() -> None:
        multiprocessing.parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
