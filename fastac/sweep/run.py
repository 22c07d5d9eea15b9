"""`fastac sweep`: every point's models trained once, every point measured, on all cores or a Dask cluster."""

import traceback
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

from fastac.scenes.schema import Scene
from fastac.store.likeness import likeness
from fastac.store.progress import progress_bar
from fastac.store.recording import unrecorded
from fastac.store.steps import Step, needed_steps
from fastac.store.store import open_store
from fastac.sweep import pools
from fastac.sweep.point_steps import origins
from fastac.sweep.points import PointModels, Setting, code_digest, generation, point_key
from fastac.sweep.pools import Pool, single_threaded
from fastac.sweep.results import Results, Row
from fastac.sweep.spec import Point, Spec, SpecError, grid
from fastac.sweep.spec import load as load_spec

ATTEMPTS = 2
"""Of a task whose process was killed; it may have been another one's fault."""


def perform(task: dict) -> dict:
    """A worker's task: perform a shared step or measure a point. Whatever goes wrong is in the answer."""
    single_threaded()
    torch.set_num_threads(1)
    setting = Setting(**task["setting"])
    if task["code"] != code_digest(Path(setting.store)):
        return {"failed": "this worker has other sources than the sweep that it works for"}
    models, store = PointModels(Scene.model_validate(task["scene"]), setting), open_store(Path(setting.store))
    try:
        with threadpool_limits(1), unrecorded():
            if task["step"] is not None:
                store.perform(models.shared[task["step"]])
                return {}
            entry = store.perform(models.point)
            return {"metrics": entry.value, "seconds": entry.seconds}
    except ValueError as error:  # a word too short, a device too small, data that lack something
        return {"infeasible": _line(error)}
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return {
            "failed": f"{type(error).__name__}: {_line(error)} ({Path(where.filename).name}:{where.lineno})"
        }


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class Grid:
    """Points that are all known from the start."""

    def __init__(self, points: Sequence[Point]):
        self.points, self.total = iter(points), len(points)

    def ask(self, under_way: int) -> Point | None:
        """The next point; None where there is none, or none before `under_way` points are fewer."""
        return next(self.points, None)

    def tell(self, point: Point, row: Row) -> None:
        """What was found of a point that was asked for."""


@dataclass
class Job:
    """A point on its way: the key of its result, and all steps that come before it."""

    key: str
    point: Point
    steps: list[Step]


class Sweep:
    """Points from a source such as `Grid`, through a pool, into results.

    Of the steps that points share each is one task; a point is a task once its steps are there.
    """

    def __init__(self, results: Results, setting: Setting, pool: Pool, source, *, progress: bool = True):
        self.results, self.setting, self.pool, self.source = results, setting, pool, source
        self.known = {row.key: row for row in results.rows() if row.status != "failed"}
        self.counts = dict.fromkeys(("done", "infeasible", "failed", "known"), 0)
        self.jobs: list[Job] = []
        self.running: dict[Future, tuple[Job, Step | None]] = {}
        self.attempts: dict[str, int] = {}
        self.store = open_store(Path(setting.store))
        self.generation, self.code = generation(setting), code_digest(Path(setting.store))
        self.present: dict[str, bool] = {}
        """By what steps have in common, whether their result is there; forgotten when a step has run."""
        self.keys: dict[Step, str] = {}
        self.bar = progress_bar(total=source.total, desc="sweep", unit="point", enabled=progress, leave=True)

    def run(self) -> dict[str, int]:
        """Measure all points; returns how many are done, infeasible, failed, and known from before."""
        self.executor = self.pool.start()
        try:
            while self._ask() or self.jobs or self.running:
                self._submit()
                done, _ = wait(self.running, return_when=FIRST_COMPLETED) if self.running else ((), ())
                for future in done:
                    self._collect(future)
        except BaseException:
            for future in self.running:  # not every executor's `shutdown` cancels them
                future.cancel()
            self.executor.shutdown(wait=False)
            raise
        finally:
            self.bar.close()
        self.executor.shutdown()
        return self.counts

    def _ask(self) -> bool:
        """Take points from the source as long as it gives any; returns whether it gave one."""
        asked = False
        while (point := self.source.ask(len(self.jobs) + len(self.running))) is not None:
            asked = True
            key = point_key(point.content, self.setting)
            models = point.scene and PointModels(point.scene, self.setting)
            if self._is_known(key, models):
                row = self.known[key]
                if row.generation != self.generation:
                    row = replace(row, generation=self.generation)
                    self.results.add(row)
                self._finish(Job(key, point, []), row)
            elif models is None:
                self._finish(Job(key, point, []), {"infeasible": point.error})
            else:
                self.jobs.append(Job(key, point, list(models.shared.values())))
        return asked

    def _is_known(self, key: str, models: PointModels | None) -> bool:
        """Whether the results have the point as the present code would find it."""
        row = self.known.get(key)
        if row is None or row.generation == self.generation:
            return row is not None
        return row.status == "done" and models is not None and self.store.is_current(models.point)

    def _key(self, step: Step) -> str:
        """What steps have in common that need running once; of a name that never ran, the name."""
        if step not in self.keys:
            known = likeness(self.store, step)
            if known is None:
                return step.name
            self.keys[step] = known
        return self.keys[step]

    def _is_present(self, step: Step) -> bool:
        key = self._key(step)
        if key not in self.present:
            self.present[key] = self.store.is_current(step)
        return self.present[key]

    def _next(self) -> tuple[Job, Step | None] | None:
        """What a free worker does: steps before points, for points take less time."""
        busy = {self._key(step) for _, step in self.running.values() if step is not None}
        for job in self.jobs:
            for step in job.steps:
                if self._is_present(step) or self._key(step) in busy:
                    continue
                if all(map(self._is_present, needed_steps(step))):
                    return job, step
        for job in self.jobs:
            if all(map(self._is_present, job.steps)):
                self.jobs.remove(job)
                return job, None
        return None

    def _submit(self) -> None:
        while len(self.running) < self.pool.slots and (found := self._next()) is not None:
            job, step = found
            task = {
                "scene": job.point.scene.model_dump(mode="json"),
                "setting": asdict(self.setting),
                "step": step and step.name,
                "code": self.code,
            }
            self.bar.set_postfix_str(step.name if step else "points")
            if step is not None and step.name == "data":
                self._outcome(job, step, perform(task))  # here, for it has processes of its own
                continue
            try:
                self.running[self.executor.submit(perform, task)] = found
            except BrokenProcessPool:
                self._return(*found)
                return

    def _collect(self, future: Future) -> None:
        job, step = self.running.pop(future)
        try:
            outcome = future.result()
        except BrokenProcessPool:
            key = self._key(step) if step else job.key
            self.attempts[key] = self.attempts.get(key, 0) + 1
            if self.attempts[key] < ATTEMPTS:
                self._return(job, step)
                return
            outcome = {"failed": "its process was killed; is there enough memory?"}
            self._restart()
        except Exception as error:  # a cluster's own, such as a worker that died too often
            outcome = {"failed": f"{type(error).__name__}: {_line(error)}"}
        self._outcome(job, step, outcome)

    def _return(self, job: Job, step: Step | None) -> None:
        """Put back what was under way when a process died, and have new processes."""
        if step is None:
            self.jobs.append(job)
        self._restart()

    def _restart(self) -> None:
        """A pool that has lost a process gives up all its tasks: go on with another once they are back."""
        if not any(not future.done() for future in self.running):
            self.executor.shutdown(wait=False)
            self.executor = self.pool.start()

    def _outcome(self, job: Job, step: Step | None, outcome: dict) -> None:
        if step is None:
            self._finish(job, outcome)
            return
        failed = self._key(step)
        self.present.clear()
        if outcome:  # no point that needs the step can be measured
            for other in [j for j in self.jobs if any(self._key(s) == failed for s in j.steps)]:
                self.jobs.remove(other)
                self._finish(other, outcome)

    def _finish(self, job: Job, outcome: dict | Row) -> None:
        if isinstance(outcome, Row):
            row, name = outcome, "known"
        else:
            status = next((name for name in ("infeasible", "failed") if name in outcome), "done")
            scene = job.point.scene and job.point.scene.model_dump(mode="json")
            row = Row(
                job.key,
                status,
                job.point.axes,
                scene,
                outcome.get("metrics", {}),
                outcome.get(status, ""),
                outcome.get("seconds", 0.0),
                self.generation,
            )
            self.results.add(row)
            self.known[row.key], name = row, status
        self.counts[name] += 1
        self.source.tell(job.point, row)
        self.bar.update()


def run(
    spec: Spec,
    base: Scene,
    folder: Path,
    results: Results,
    setting: Setting,
    pool: Pool,
    *,
    points: Sequence[Point] | None = None,
    progress: bool = True,
) -> dict[str, int]:
    """Measure all points of a specification in `folder` into `results`; see `Sweep.run`.

    points : of the grid, if they have been made already
    """
    known = {"spec": spec.model_dump(mode="json"), "scene": base.model_dump(mode="json")}
    known |= {"setting": asdict(setting), "generation": generation(setting)}
    results.set_facts(known | {"origins": origins()})
    if spec.method == "grid":
        source = Grid(list(grid(spec, base, folder)) if points is None else points)
    else:
        from fastac.sweep.optimiser import Optimiser

        source = Optimiser(spec, base, results, folder, pool.slots)
    return Sweep(results, setting, pool, source, progress=progress).run()


def explore(
    path: Path,
    output: Path,
    *,
    store: Path = Path("build/store"),
    workers: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> dict[str, int]:
    """Measure all points of the specification in the TOML file `path` into the results file `output`.

    store : folder of the step store, which keeps datasets and trained models
    workers : local processes; None: one on each core; 0: none but this one, which is best for few points
    scheduler : address of a Dask cluster, whose workers are used instead

    Returns how many points are done, infeasible, failed, and known from before. Raises SpecError or
    SceneError for a file that cannot be used, before anything is written, and SweepError where no scheduler
    answers.

    >>> explore(Path("sweeps/quantisation.toml"), Path("build/sweep/quantisation.sqlite"), workers=2)
    """
    spec, base = load_spec(path)
    data = spec.data and str((path.parent / spec.data).resolve())
    if data is None and base.sensor.source == "recorded":
        raise SpecError(f"{path}: data: missing: scene {base.name} is of a recorded sensor")
    setting = Setting(str(store.resolve()), data, spec.split, spec.frames)
    # A point that cannot be made ends the sweep before it writes anything.
    points = list(grid(spec, base, path.parent)) if spec.method == "grid" else None
    results = Results(output)
    if scheduler:
        where = pools.dask_pool(scheduler)
    else:
        where = pools.this_process() if workers == 0 else pools.local_pool(workers)
    threads = torch.get_num_threads()
    try:
        with where as pool:
            return run(spec, base, path.parent, results, setting, pool, points=points, progress=progress)
    finally:
        torch.set_num_threads(threads)
