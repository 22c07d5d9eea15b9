"""Workers of a sweep: processes of this machine or a Dask cluster."""

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


ANSWER_S = 30
"""How long a scheduler may take to answer; a loaded machine needs 10 s to start the client's own loop."""


class SweepError(RuntimeError):
    """A sweep that cannot run; the message is one line."""


@dataclass(frozen=True)
class Pool:
    """Where tasks run: in what `start` makes, and again if its processes are killed; `slots` at once."""

    start: Callable[[], Executor]
    slots: int


def single_threaded() -> None:
    """Each worker has one core: nothing in it may start more threads."""
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """A process for each core, or `workers`."""
    workers = workers or os.cpu_count() or 1
    single_threaded()  # what a process inherits before it loads BLAS
    spawn = get_context("spawn")
    yield Pool(lambda: ProcessPoolExecutor(workers, mp_context=spawn, initializer=_follow), workers)


def _follow() -> None:
    """End this process with its parent, however that ends."""

    def watch() -> None:
        parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def dask_pool(address: str) -> Iterator[Pool]:
    """The workers of a Dask cluster, which must see the same files. Raises SweepError if there are none."""
    try:
        from distributed import Client
    except ImportError:
        raise SweepError("--scheduler: Dask is not installed: run pip install -e '.[sweep]'") from None
    try:
        client = Client(address, timeout=ANSWER_S)
    except (OSError, ValueError) as error:
        raise SweepError(f"--scheduler {address}: no scheduler answers: {error}") from None
    with client:
        slots = sum(client.nthreads().values())
        if not slots:
            raise SweepError(f"--scheduler {address}: the cluster has no workers")
        yield Pool(lambda: client.get_executor(pure=False), slots)
