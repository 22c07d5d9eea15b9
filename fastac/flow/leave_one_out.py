"""What a model trained from forces is worth: each group left out once, and simple models beside it."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.flow import force_training, frames, training
from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.models.training.force import ridge
from fastac.models.training.force.force_start import background_differences
from fastac.models.training.force.smooth_weights import SmoothWeights
from fastac.report.tables import mean_and_spread, text_table
from fastac.scenes.schema import Scene, with_seed
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.groups import left_out_together
from fastac.sensor.importers.force_labels import split_by_group
from fastac.store.files import load_arrays
from fastac.store.progress import progress_bar
from fastac.store.side_by_side import ended
from fastac.store.steps import Step
from fastac.store.store import open_store

MODELS = ("float", "integer", "linear", "robust linear", "quadratic")
"""Columns of the table: the model's two arithmetics, a ridge on the pixels' differences from the background,
the models' own last fit on these, and a quadratic in the differences' sum."""
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


def linear_forces_n(
    data: Dataset, axes: tuple[int, ...], patience: int | None = None
) -> dict[str, np.ndarray]:
    """Forces (test frames, axes) of two ridges on the pixels' differences, whose weights are smooth over the
    image: "linear" by squares of errors, with the size that is best on recordings left out; "robust linear"
    as the models' last fit, by Huber's loss and the average over sizes.

    The differences are those of single pixels, whatever the scene's network sees.

    patience : as in `SmoothWeights.errors`
    """
    splits = {split: index for split in ("train", "validation") if len(index := data.indices(split))}
    change = {split: background_differences(data, index) for split, index in splits.items()}
    force = {split: data.forces_n(index, axes) for split, index in splits.items()}
    tested = background_differences(data, data.indices("test"))
    together, found = left_out_together(data), {}
    recording = {split: together[index] for split, index in splits.items()}
    for name, robust in (("linear", False), ("robust linear", True)):
        model = SmoothWeights(change, force, robust=robust)
        errors = model.errors(recording=recording, patience=patience)
        if robust:
            weights, *_ = model.average(errors)
        else:
            weights, _ = model.weights(ridge.best(errors), with_validation=False)
        found[name] = np.einsum("nijc,aijc->na", tested, weights)
    return found


def quadratic_force_n(data: Dataset, axes: tuple[int, ...]) -> np.ndarray:
    """Forces (test frames, axes) of a + b·s + c·s², s the sum of all absolute differences, least squares."""
    sums = np.array([np.abs(background_differences(data, [k])).mean() for k in range(len(data))])
    x = sums[:, None] ** np.arange(3)
    seen, test = np.flatnonzero(data.split != "test"), data.indices("test")
    return x[test] @ np.linalg.lstsq(x[seen], data.forces_n(seen, axes), rcond=None)[0]


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
    """A step: mean absolute errors, N, of all models on a group of recordings, trained on the others.

    On one core, so that groups can be trained side by side and the result does not depend on how many are.
    """
    with threadpool_limits(1):
        known = frames.read(data, scene, store=store, progress=progress)
        known = replace(known, split=split_by_group(known.group, (group,)))
        model, index = train(known, without_interval(scene), folder, progress=progress), known.indices("test")
        truth = known.forces_n(index, scene.force_axes)
        found = {
            name: value["force_mae_n"]
            for name, value in accuracy.compare_pipelines(model, known, index, progress=progress)[0].items()
            if name in MODELS
        }
        estimates = {
            **linear_forces_n(known, scene.force_axes, scene.training.patience_sizes),
            "quadratic": quadratic_force_n(known, scene.force_axes),
        }
    found |= {name: float(np.abs(estimate - truth).mean()) for name, estimate in estimates.items()}
    return {"frames": len(index), "mae_n": found}


def step_of(path: Path, scene: Scene, group: str, store: Path, *, progress: bool) -> Step:
    """The step of the store in the folder `store` that leaves a group out."""
    arguments = {"data": path, "scene": scene, "group": group}
    return Step("left_out", without_group, arguments, (), {"store": store, "progress": progress})


def perform(path: Path, scene: Scene, group: str, store: Path) -> dict:
    """What `without_group` finds, for a process of its own."""
    return open_store(store).value(step_of(path, scene, group, store, progress=False))


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

    Each group's training is a step of the store in the folder `store`, so that an interrupted run goes on
    where it stopped. Groups count alike in the mean.

    seeds : of the trainings, one of each group with each; None: the scene's own
    start : makes the processes that train groups side by side; None, or one training: this process does
    """
    groups, kept = check(data, scene, path), open_store(store)
    seeds = [scene.training.seed] if seeds is None else list(seeds)
    scenes = [with_seed(scene, seed) for seed in seeds]
    steps = {
        (k, name): step_of(path, own, name, store, progress=progress)
        for k, own in enumerate(scenes)
        for name in groups
    }
    missing = [key for key, step in steps.items() if not kept.is_current(step)]
    with progress_bar(total=len(steps), desc="groups", unit="group", enabled=progress, leave=True) as bar:
        bar.update(len(steps) - len(missing))
        if start is not None and len(missing) > 1:
            tasks = [(path, scenes[k], name, store) for k, name in missing]
            for _ in _side_by_side(tasks, start()):
                bar.update()
        else:
            for key in missing:
                kept.value(steps[key])
                bar.update()
    runs = []
    for k in range(len(seeds)):
        found = {name: kept.value(steps[k, name]) for name in groups}
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
