"""What a model trained from forces is worth: each group left out once, and simple models beside it."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.flow import force_training, frames, simple_models, training
from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.report.tables import mean_and_spread, text_table
from fastac.scenes.schema import Scene, with_seed
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.importers.force_labels import split_by_group
from fastac.store.files import load_arrays
from fastac.store.progress import progress_bar
from fastac.store.side_by_side import ended
from fastac.store.steps import Step
from fastac.store.store import open_store

TRAINED = ("float", "integer")
"""The two arithmetics of what is trained."""
MODELS = (*TRAINED, *simple_models.MODELS)
"""Columns of the table."""
HEAD = ("left out", "frames", *(f"{model}, N" for model in MODELS))


def check(data: Dataset, scene: Scene, path: Path) -> list[str]:
    """The groups, in order; raises DatasetError unless each can be left out."""
    if scene.training.labels != "force":
        raise DatasetError(
            f"scene {scene.name}: training.labels = {scene.training.labels!r}: groups are left out of"
            " trainings from forces"
        )
    if data.group is None:
        raise DatasetError(f"{path}: group: missing, so there is nothing to leave out")
    groups = list(dict.fromkeys(data.group.tolist()))
    if len(groups) < 2:
        raise DatasetError(f"{path}: group = {groups[0]!r} alone: expected at least two")
    return groups


def without_interval(scene: Scene) -> Scene:
    """The scene without intervals around forces, which need groups that were not trained on."""
    if not scene.wants_interval:
        return scene
    return scene.model_copy(update={"force": scene.force.model_copy(update={"coverage": None})})


def train(data: Dataset, scene: Scene, folder: Path, *, progress: bool) -> Bundle:
    """The whole training of `fastac train`, in `folder`."""
    weights, integers, force = (folder / name for name in ("normals.npz", "integers.npz", "force.npz"))
    training.normals(data, scene, weights, progress=progress)
    training.integers(data, scene, weights, integers, progress=progress)
    if scene.wants_force:
        force_training.force(data, scene, weights, integers, force, progress=progress)
    arrays = [load_arrays(path) if path.exists() else {} for path in (weights, integers, force)]
    return training.assemble(data, scene, *arrays, folder / "bundle")


def without_group(folder: Path, data: Path, scene: Scene, group: str, *, store: Path, progress: bool) -> dict:
    """A step: mean absolute errors, N, of the model on a group of recordings, trained on the others, in both
    arithmetics.

    On one core, so that groups can be trained side by side and the result does not depend on how many are.
    """
    with threadpool_limits(1):
        known = frames.read(data, scene, store=store, progress=progress)
        known = replace(known, split=split_by_group(known.group, (group,)))
        model, index = train(known, without_interval(scene), folder, progress=progress), known.indices("test")
        found, _ = accuracy.compare_pipelines(model, known, index, progress=progress)
    return {"frames": len(index), "mae_n": {name: found[name]["force_mae_n"] for name in TRAINED}}


def step_of(path: Path, scene: Scene, group: str, store: Path, *, progress: bool) -> Step:
    """The step of the store in the folder `store` that leaves a group out."""
    arguments = {"data": path, "scene": scene, "group": group}
    return Step("left_out", without_group, arguments, (), {"store": store, "progress": progress})


def perform(make: Callable[..., Step], path: Path, scene: Scene, group: str, store: Path) -> object:
    """The value of the step that `make` makes, such as `step_of`, for a process of its own."""
    return open_store(store).value(make(path, scene, group, store, progress=False))


def _side_by_side(tasks: list[tuple], executor: Executor) -> Iterator[None]:
    """Perform tasks, arguments of `perform`, in the executor's processes; yields whenever one is done."""
    with ended(executor):
        for done in as_completed([executor.submit(perform, *task) for task in tasks]):
            done.result()
            yield


def evaluate(
    data: Dataset,
    scene: Scene,
    path: Path,
    store: Path,
    *,
    seeds: Sequence[int] | None = None,
    start: Callable[[], Executor] | None = None,
    progress: bool,
) -> dict:
    """Errors with each group left out, {"data": …, "seeds": [...], "runs": [{"groups": {name: …},
    "mean_mae_n": {model: N}}, one for each seed]}.

    Each group's training is a step of the store in the folder `store`, and so are its simple models, which no
    seed changes; an interrupted run goes on where it stopped. Groups count alike in the mean.

    seeds : of the trainings, one of each group with each; None: the scene's own
    start : makes the processes that train groups side by side; None, or one training: this process does
    """
    groups, kept = check(data, scene, path), open_store(store)
    seeds = [scene.training.seed] if seeds is None else list(seeds)
    made = {"simple": (simple_models.step_of, scene)}
    made |= {seed: (step_of, with_seed(scene, seed)) for seed in seeds}
    tasks = {
        (key, name): (make, path, own, name, store) for key, (make, own) in made.items() for name in groups
    }
    steps = {key: make(*task, progress=progress) for key, (make, *task) in tasks.items()}
    missing = [key for key, step in steps.items() if not kept.is_current(step)]
    with progress_bar(total=len(steps), desc="groups", unit="group", enabled=progress, leave=True) as bar:
        bar.update(len(steps) - len(missing))
        if start is not None and len(missing) > 1:
            for _ in _side_by_side([tasks[key] for key in missing], start()):
                bar.update()
        else:
            for key in missing:
                kept.value(steps[key])
                bar.update()
    simple, runs = {name: kept.value(steps["simple", name]) for name in groups}, []
    for seed in seeds:
        found = {name: kept.value(steps[seed, name]) for name in groups}
        found = {name: entry | {"mae_n": entry["mae_n"] | simple[name]} for name, entry in found.items()}
        means = {m: float(np.mean([entry["mae_n"][m] for entry in found.values()])) for m in MODELS}
        runs.append({"groups": found, "mean_mae_n": means})
    return {"data": str(path), "seeds": seeds, "runs": runs}


def rows(runs: Sequence[dict], digits: int = 4) -> list[list]:
    """Errors of the MODELS, N, as texts: a row for each group, [name, frames, …] of means over the runs, and
    one of the mean over groups, with the spread over the runs where these differ."""
    of_groups = [
        [
            name,
            entry["frames"],
            *(f"{np.mean([run['groups'][name]['mae_n'][m] for run in runs]):.{digits}f}" for m in MODELS),
        ]
        for name, entry in runs[0]["groups"].items()
    ]
    means = [[run["mean_mae_n"][m] for run in runs] for m in MODELS]
    once = [values if np.ptp(values) else values[:1] for values in means]  # some have nothing to draw
    return [*of_groups, ["mean", None, *(mean_and_spread(values, digits) for values in once)]]


def table(content: dict) -> str:
    """The errors as text: a row for each group that was left out, and one for the mean."""
    return text_table(HEAD, rows(content["runs"]))
