"""The interval around each force, from the errors of presses that the models have not learned from."""

import numpy as np

from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.force_interval import LOAD, ForceInterval, shifts_of
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.models.training import conformal
from fastac.models.training.drift import drifted
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import groups
from fastac.sensor.samples import evenly_spaced

INTERVAL = "force_interval"
"""In a bundle's provenance: what its intervals hold and follow from, as `calibrated` returns it."""
FITTED_FRAMES = 1000
"""Most frames of the training split, evenly spaced, that the widths' dependence on the measures follows from,
as they are and drifted."""
NORMAL_AXIS = 2
WANTED = ("force_n", "force_raw", "validity_measures")


def candidates(pipeline: IntegerPipeline) -> tuple[tuple[str, ...], np.ndarray]:
    """The measures that widths may follow from, and the largest magnitude of each."""
    validity = pipeline.validity
    names = [n for n in validity.names if n.startswith("brightness") or n in ("change", "gradient")]
    largest = dict(zip(validity.names, validity.bounds[1], strict=True))
    limits = [int(largest[name]) for name in names] + [pipeline.force_bound]
    return (*names, LOAD), np.array(limits, np.int64)


def load_axis(axes: tuple[int, ...]) -> int:
    """Which of the forces counts as the load: that along the skin's normal, or else the first."""
    return axes.index(NORMAL_AXIS) if NORMAL_AXIS in axes else 0


def calibrated(pipeline: IntegerPipeline, data: Dataset) -> tuple[IntegerPipeline, dict]:
    """The integers with intervals around their forces, and what these hold and follow from.

    How widths depend on the measures follows from errors in the training split, where half of the frames have
    a drift that the limits of frame validity leave unseen; how wide they are from the errors of the whole
    groups of the validation split, see `training/conformal.py`. Returned besides: "asked", the scene's
    coverage; "coverage", what the intervals are made for, which is less where there are too few groups;
    "groups" and "frames" of the validation split.
    """
    scene = pipeline.scene
    names, limits = candidates(pipeline)
    shifts, axis = shifts_of(limits), load_axis(scene.force_axes)
    emulator = Emulator(pipeline)

    def magnitudes(found: Result) -> np.ndarray:
        columns = [pipeline.validity.names.index(name) for name in names[:-1]]
        raw = np.column_stack([found.validity_measures[:, columns], found.force_raw[:, axis]])
        return np.abs(raw >> shifts)

    def errors(found: Result, index: np.ndarray) -> np.ndarray:
        return np.abs(found.force_n - data.forces_n(index, scene.force_axes))

    seen = evenly_spaced(data.indices("train"), FITTED_FRAMES)
    frames = data.frames[seen]
    moved = drifted(frames, data.background, pipeline.validity, scene.training.seed)
    runs = [emulator.run(images, wanted=WANTED) for images in (frames, moved)]
    known = np.concatenate([magnitudes(found) for found in runs])
    known_errors = np.concatenate([errors(found, seen) for found in runs])

    held = data.indices("validation")
    group = groups(data)[held]
    count = len(np.unique(group))
    coverage = min(scene.force.coverage, conformal.supported(count))
    found = emulator.run(data.frames[held], wanted=WANTED)
    held_magnitudes, held_errors = magnitudes(found), errors(found, held)
    base, weights = [], []
    for k, unit_n in enumerate(pipeline.force_n_per_unit):
        least, slopes = conformal.linear_scale(known, known_errors[:, k])
        scores = held_errors[:, k] / (least + held_magnitudes @ slopes)
        factor = conformal.pooled_quantile(scores, group, coverage) / unit_n
        base.append(factor * least)
        weights.append(factor * slopes)
    weights = np.array(weights)
    used = weights.any(axis=0)
    interval = ForceInterval.of_weights(
        tuple(name for name, kept in zip(names, used, strict=True) if kept),
        limits[used],
        weights[:, used],
        np.array(base),
        axis,
    )
    about = {"asked": scene.force.coverage, "coverage": coverage, "groups": count, "frames": len(held)}
    return pipeline.replace(interval=interval), about


def remark(pipeline: IntegerPipeline) -> str | None:
    """One line where the intervals hold less than the scene asks; None where they do not."""
    about = pipeline.provenance.get(INTERVAL)
    if about is None or about["coverage"] >= about["asked"]:
        return None
    return (
        f"force.coverage = {about['asked']:g}: {about['groups']} groups of the validation split support at"
        f" most {100 * about['coverage']:.1f}%, which the intervals are made for"
    )
