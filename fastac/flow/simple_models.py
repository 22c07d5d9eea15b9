"""Models of the force without a network, beside which those trained from forces stand: two ridges on the
pixels and a quadratic in their sum."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.flow import frames
from fastac.models.training.force import ridge
from fastac.models.training.force.force_start import background_differences
from fastac.models.training.force.smooth_weights import SmoothWeights
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import left_out_together
from fastac.sensor.importers.force_labels import split_by_group
from fastac.store.steps import Step

MODELS = ("linear", "robust linear", "quadratic")
"""A ridge on the pixels' differences from the background, the trained models' own last fit on these, and a
quadratic in the differences' sum."""


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


def without_group(
    folder: Path, data: Path, scene: Scene, group: str, *, store: Path, progress: bool
) -> dict[str, float]:
    """A step: mean absolute errors, N, of the MODELS on a group of recordings, fitted to the others, on one
    core.

    It reads little of the scene, so that trainings which differ by their seed alone, or by much else, share
    it.
    """
    with threadpool_limits(1):
        known = frames.read(data, scene, store=store, progress=progress)
        known = replace(known, split=split_by_group(known.group, (group,)))
        axes = scene.force_axes
        truth = known.forces_n(known.indices("test"), axes)
        found = linear_forces_n(known, axes, scene.training.patience_sizes)
        found["quadratic"] = quadratic_force_n(known, axes)
    return {name: float(np.abs(forces - truth).mean()) for name, forces in found.items()}


def step_of(data: Path, scene: Scene, group: str, store: Path, *, progress: bool) -> Step:
    """The step of the store in the folder `store` that leaves a group out."""
    arguments = {"data": data, "scene": scene, "group": group}
    return Step("simple_models", without_group, arguments, (), {"store": store, "progress": progress})
