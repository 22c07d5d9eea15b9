"""Steps that do not need each other, performed side by side in processes."""

import multiprocessing
from collections.abc import Sequence
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
