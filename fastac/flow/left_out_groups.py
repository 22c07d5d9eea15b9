"""Errors of models that did not know a group, for each training group: what intervals are calibrated on where
the validation split has no groups of its own.

Recordings of a few objects have frames of each object in both splits, so that the validation split tells
nothing of a new object. Leaving each group out once (the jackknife over groups, without its correction for
the trainings' differences) costs a training a group, each kept in the step store.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.flow import frames, leave_one_out
from fastac.flow.intervals import held_out_scores, training_groups
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.importers.force_labels import split_by_group
from fastac.sensor.samples import subset
from fastac.store.files import load_arrays, save_arrays
from fastac.store.steps import Step
from fastac.store.store import open_store

SCORES = "scores.npz"


def scores(
    data: Dataset, scene: Scene, path: Path, store: Path, *, progress: bool
) -> tuple[np.ndarray, np.ndarray] | None:
    """Scores (frames, axes) of all `intervals.training_groups`, and their groups (frames,); None without any.

    path : the dataset's file
    """
    found, group = [], []
    for k, name in enumerate(training_groups(data)):
        step = step_of(path, scene, name, store, progress=progress)
        of_group = load_arrays(open_store(store).perform(step).path(SCORES))["scores"]
        found.append(of_group)
        group += [k] * len(of_group)
    return (np.concatenate(found), np.array(group)) if found else None


def step_of(path: Path, scene: Scene, group: str, store: Path, *, progress: bool) -> Step:
    """The step of the store in the folder `store` that leaves a group out."""
    # Without its coverage, so that another one needs no other trainings.
    arguments = {"data": path, "scene": leave_one_out.without_interval(scene), "group": group}
    return Step("interval_scores", leave_out, arguments, (SCORES,), {"store": store, "progress": progress})


def leave_out(folder: Path, data: Path, scene: Scene, group: str, *, store: Path, progress: bool) -> None:
    """A step: train without a group and the test split; write the scores of the group's frames."""
    known = frames.read(data, scene, store=store, progress=progress)
    known = subset(known, np.flatnonzero(known.split != "test"))
    known = replace(known, split=split_by_group(known.group, (group,)))
    model = leave_one_out.train(known, scene, folder, progress=progress)
    save_arrays(folder / SCORES, {"scores": held_out_scores(model.pipeline, known, known.indices("test"))})
