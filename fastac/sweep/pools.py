"""Workers of a sweep: processes on this machine, or a Dask cluster."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from fastac.store.side_by_side import new_processes

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
SCHEDULER_TIMEOUT_S = 30
"""For a Dask scheduler to answer; on a loaded machine the client alone needs 10 s to start."""


class SweepError(RuntimeError):
    """A sweep that cannot run; the message is one line."""


@dataclass(frozen=True)
class Pool:
    """Where tasks run.

    start : makes the executor, and a new one if its processes are killed
    slots : number of tasks at once
    """

    start: Callable[[], Executor]
    slots: int


def single_threaded() -> None:
    """Limit OpenMP, OpenBLAS and MKL to one thread, since each worker has one core."""
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"


@contextmanager
def local_pool(workers: int | None = None) -> Iterator[Pool]:
    """A pool of `workers` processes on this machine; None: one for each core."""
    workers = workers or os.cpu_count() or 1
    single_threaded()  # before the processes start, since BLAS reads the variables when it is loaded
    yield Pool(lambda: new_processes(workers), workers)


@contextmanager
def this_process() -> Iterator[Pool]:
    """A pool of one task at a time in this process, for few points: another process takes seconds to start.

    A task limits its libraries to one thread (`single_threaded`); the variables are as before at the end.
    """
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    try:
        yield Pool(lambda: ThreadPoolExecutor(1), 1)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def dask_pool(address: str) -> Iterator[Pool]:
    """The workers of a Dask cluster, which must see the same files. Raises SweepError if there are none."""
    try:
        from distributed import Client
    except ImportError:
        raise SweepError("--scheduler: Dask is not installed: run pip install -e '.[sweep]'") from None
    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise SweepError(f"--scheduler {address}: no scheduler answers: {error}") from None
    with client:
        slots = sum(client.nthreads().values())
        if not slots:
            raise SweepError(f"--scheduler {address}: the cluster has no workers")
        yield Pool(lambda: client.get_executor(pure=False), slots)
