"""What a model trained from forces is worth: each group left out once, and two simple models beside it."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.flow import training
from fastac.models import accuracy
from fastac.models.integer.bundle import Bundle
from fastac.models.training import slope_force
from fastac.models.training.from_forces import background_differences
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset, DatasetError
from fastac.sensor.importers.force_labels import split_by_group
from fastac.store.files import digest_file, write_json
from fastac.store.progress import progress_bar
from fastac.store.sources import digest_sources

MODELS = ("float", "integer", "linear", "quadratic")
"""Columns of the table: the model's two arithmetics, a ridge on the pixels' differences from the background,
and a quadratic in their sum."""


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


def linear_force_n(data: Dataset, axes: tuple[int, ...]) -> np.ndarray:
    """Forces (test frames, axes) of a ridge on the pixels' differences, its weights smooth over the image."""
    splits = {split: index for split in ("train", "validation") if len(index := data.indices(split))}
    weights, _ = slope_force.fit(
        {split: background_differences(data, index) for split, index in splits.items()},
        {split: data.forces_n(index, axes) for split, index in splits.items()},
    )
    return np.einsum("nijc,aijc->na", background_differences(data, data.indices("test")), weights)


def quadratic_force_n(data: Dataset, axes: tuple[int, ...]) -> np.ndarray:
    """Forces (test frames, axes) of a + b·s + c·s², s the sum of all absolute differences, least squares."""
    sums = np.array([np.abs(background_differences(data, [k])).mean() for k in range(len(data))])
    x = sums[:, None] ** np.arange(3)
    seen, test = np.flatnonzero(data.split != "test"), data.indices("test")
    return x[test] @ np.linalg.lstsq(x[seen], data.forces_n(seen, axes), rcond=None)[0]


def train(data: Dataset, scene: Scene, folder: Path, *, progress: bool) -> Bundle:
    """The whole training of `fastac train`, in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    weights, integers = folder / "normals.npz", folder / "integers.npz"
    training.normals(data, scene, weights, progress=progress)
    training.integers(data, scene, weights, integers, progress=progress)
    training.force(data, scene, weights, integers, folder / "force.npz", progress=progress)
    return training.assemble(data, scene, folder, folder / "bundle")


def errors(data: Dataset, scene: Scene, folder: Path, *, progress: bool) -> dict:
    """Mean absolute errors, N, of all models on the test split, trained on the others."""
    model, index = train(data, scene, folder, progress=progress), data.indices("test")
    truth = data.forces_n(index, scene.force_axes)
    found = {
        name: value["force_mae_n"]
        for name, value in accuracy.compare_pipelines(model, data, index, progress=progress)[0].items()
        if name in MODELS
    }
    for name, estimate in (("linear", linear_force_n), ("quadratic", quadratic_force_n)):
        found[name] = float(np.abs(estimate(data, scene.force_axes) - truth).mean())
    return {"frames": len(index), "mae_n": found}


def evaluate(data: Dataset, scene: Scene, path: Path, folder: Path, *, progress: bool) -> dict:
    """Errors with each group left out, {"groups": {name: …}, "mean_mae_n": {model: N}}.

    Every group's result is kept in `folder` and taken from there as long as data, scene and code are the
    same, so that an interrupted run goes on where it stopped. Groups count alike in the mean.
    """
    groups = check(data, scene, path)
    settings = [
        scene.model_dump(mode="json"),
        digest_file(path),
        digest_sources(("models/**/*.py", "fastac/flow/training.py", "fastac/flow/leave_one_out.py")),
    ]
    key = hashlib.sha256(json.dumps(settings).encode()).hexdigest()
    found = {}
    for number, name in enumerate(
        progress_bar(groups, desc="groups", unit="group", enabled=progress, leave=True)
    ):
        own = folder / f"group{number}"
        result = own / "errors.json"
        kept = json.loads(result.read_text()) if result.exists() else {}
        if kept.get("key") != key:
            left_out = replace(data, split=split_by_group(data.group, (name,)))
            kept = {"key": key, "group": name, **errors(left_out, scene, own, progress=progress)}
            write_json(result, kept)
        found[name] = {"frames": kept["frames"], "mae_n": kept["mae_n"]}
    means = {model: float(np.mean([entry["mae_n"][model] for entry in found.values()])) for model in MODELS}
    return {"data": str(path), "groups": found, "mean_mae_n": means}


def table(content: dict) -> str:
    """The errors as text: a row for each group that was left out, and one for the mean."""
    rows = [(name, entry["frames"], entry["mae_n"]) for name, entry in content["groups"].items()]
    return text_table(
        ["left out", "frames", *(f"{model}, N" for model in MODELS)],
        [
            [name, frames, *(f"{mae_n[model]:.4f}" for model in MODELS)]
            for name, frames, mae_n in (*rows, ("mean", None, content["mean_mae_n"]))
        ],
    )
