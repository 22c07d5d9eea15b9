"""Parallel processing of many frames: one thread per core, each with a chunk of frames at a time."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from fastac.store.progress import progress_bar

CHUNK = 16
"""Frames per call of a worker; bounds the memory."""

Outputs = dict[str, tuple[tuple[int, ...], type]]
"""For each output, by name, its shape for one frame and its element type."""


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def threads() -> int:
    """Number of threads: OMP_NUM_THREADS if it is set, as for BLAS, otherwise one per core."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return int(stated) if stated.isdecimal() and int(stated) else os.cpu_count() or 1


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


def over_frames(
    worker: Callable[[], Callable[[np.ndarray, dict[str, np.ndarray]], None]],
    frames: np.ndarray,
    outputs: Outputs,
    *,
    progress: bool,
    label: str,
) -> dict[str, np.ndarray]:
    """Process frames chunk by chunk; returns an array (frames, …) for each of `outputs`.

    worker : called once in each thread, and returns the function that processes a chunk; that function may
        own scratch memory. It is called with a chunk of frames and, by name, the views of the result arrays
        that it fills.
    label : name of the progress bar
    Threads run in parallel because NumPy, torch and compiled loops release the interpreter's lock; BLAS is
    limited to one thread in each. Raises ValueError without frames.
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
