"""Scaling of a sweep with the number of workers: the same points on one Dask worker, then on several.

    fastac bench sweep SWEEP_TOML [--points N] [--workers 1,2] [--store FOLDER]

All models are trained before the timing. Every worker is a process of this machine with one thread, and
measures one point (which loads the frames) before the timing; no result is kept.
"""

import logging
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from fastac.store.progress import progress_bar
from fastac.store.store import open_store
from fastac.sweep import pools
from fastac.sweep import run as sweeps
from fastac.sweep import spec as sweep_spec
from fastac.sweep.points import PointModels, Setting
from fastac.sweep.results import Results
from fastac.sweep.spec import Point


def measurable(spec: sweep_spec.Spec, base, folder: Path, count: int, setting: Setting) -> list[Point]:
    """Up to `count` feasible points of the grid, all measured once, so that their models are in the store."""
    chosen: list[Point] = []
    with progress_bar(total=count, desc="preparing", unit="point") as bar:
        for point in sweep_spec.grid(spec, base, folder):
            if len(chosen) == count:
                break
            if point.scene is None:
                continue
            try:
                open_store(Path(setting.store)).perform(PointModels(point.scene, setting).point)
            except ValueError:  # infeasible, such as a word too short: would distort the time per point
                continue
            chosen.append(point)
            bar.update()
    return chosen


def seconds(points: list[Point], setting: Setting, workers: int, folder: Path) -> float:
    """Wall-clock time in s for all points on `workers` workers, after a warm-up point on each.

    Raises RuntimeError where a point fails.
    """
    from distributed import LocalCluster

    pools.single_threaded()
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
        ) as cluster,
        pools.dask_pool(cluster.scheduler_address) as pool,
    ):
        for part in (points[:workers], points):
            results = Results(folder / f"{workers}_{len(part)}.sqlite")
            start = time.perf_counter()
            counts = sweeps.Sweep(results, setting, pool, sweeps.Grid(part), progress=False).run()
            took = time.perf_counter() - start
            if counts["done"] != len(part):
                raise RuntimeError(f"{workers} workers: {counts}: expected {len(part)} done")
    return took


def measure(spec: Path, points: int, workers: tuple[int, ...], store: Path) -> Iterator[str]:
    """Time the points of a specification with each number of workers; yields one line of text per number."""
    content, base = sweep_spec.load(spec)
    data = content.data and str((spec.parent / content.data).resolve())
    setting = Setting(str(store.resolve()), data, content.split, content.frames)
    chosen = measurable(content, base, spec.parent, points, setting)
    first = None
    with tempfile.TemporaryDirectory() as folder:
        for count in workers:
            took = seconds(chosen, setting, count, Path(folder))
            first = first or took
            rate = f"{took / len(chosen):.2f} s a point"
            yield f"{count} workers: {len(chosen)} points in {took:.1f} s, {rate}, {first / took:.2f}×"
