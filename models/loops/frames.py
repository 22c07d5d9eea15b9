"""Work over many frames: a thread for each core, a chunk of frames at a time."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from fastac.store.progress import progress_bar

CHUNK = 16
"""Frames that are under way at once in each thread; bounds the memory."""

Outputs = dict[str, tuple[tuple[int, ...], type]]
"""Of each output the shape for one frame and the element type."""


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def threads() -> int:
    """OMP_NUM_THREADS where it is set, as for BLAS; else one for each core."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return int(stated) if stated.isdecimal() and int(stated) else os.cpu_count() or 1


def choose_outputs(outputs: Outputs, wanted: Iterable[str] | None) -> Outputs:
    """The outputs that are wanted, or all; raises ValueError for one that there is not."""
    if wanted is None:
        return outputs
    for name in (wanted := tuple(wanted)):
        if name not in outputs:
            raise ValueError(f"wanted {name!r}: expected some of {', '.join(outputs)}")
    return {name: outputs[name] for name in wanted}


def require_frames(frames: np.ndarray, background: np.ndarray) -> None:
    """Raise ValueError where frames are not uint8 of the background's shape."""
    if frames.shape[1:] != background.shape or frames.dtype != np.uint8:
        raise ValueError(f"frames {frames.shape} {frames.dtype}: expected {background.shape} uint8 each")


def over_frames(
    worker: Callable[[], Callable[[np.ndarray, dict[str, np.ndarray]], None]],
    frames: np.ndarray,
    outputs: Outputs,
    *,
    progress: bool,
    label: str,
) -> dict[str, np.ndarray]:
    """Arrays (frames, …) of `outputs`, filled chunk by chunk.

    worker : called once in each thread, so that its result may own scratch memory; that is called with a
        chunk of frames and, by name, the places of its outputs
    NumPy, torch and compiled loops do without the interpreter's lock, BLAS on one thread in each of ours.
    """
    if not len(frames):
        raise ValueError("frames: none to process")
    found = {name: np.empty((len(frames), *shape), kind) for name, (shape, kind) in outputs.items()}
    workers = min(threads(), len(frames))
    step = min(CHUNK, -(-len(frames) // workers))
    local = threading.local()

    def run(start: int) -> int:
        if not hasattr(local, "worker"):
            local.worker = worker()
        part = slice(start, start + step)
        local.worker(frames[part], {name: array[part] for name, array in found.items()})
        return len(frames[part])

    with (
        progress_bar(total=len(frames), desc=label, unit="frame", enabled=progress) as bar,
        _blas().limit(limits=1, user_api="blas"),
        ThreadPoolExecutor(workers) as pool,
    ):
        for count in pool.map(run, range(0, len(frames), step)):
            bar.update(count)
    return found
