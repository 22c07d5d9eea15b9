"""The interval around each force, from the errors of presses that the models have not learned from."""

from dataclasses import dataclass, replace

import numpy as np

from fastac.flow.few_presses import presses
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.force_interval import INTERVAL, LOAD, ForceInterval, shifts_of
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.models.training.drift import drifted
from fastac.models.training.force import conformal
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import groups
from fastac.sensor.samples import evenly_spaced

FITTED_FRAMES = 1000
"""Most frames of the training split, evenly spaced, that the widths' dependence on the measures follows from,
as they are and drifted."""
NORMAL_AXIS = 2
WANTED = ("force_n", "force_raw", "validity_measures")


def apart(data: Dataset) -> np.ndarray:
    """The frames of the validation split whose groups have no frame in the training split, indices."""
    group = groups(data)
    return np.flatnonzero((data.split == "validation") & ~np.isin(group, group[data.split == "train"]))


def training_groups(data: Dataset) -> list[str]:
    """The groups to leave out one after the other; none where the validation split has groups of its own, or
    where fewer than two are known."""
    if len(apart(data)) or data.group is None:
        return []
    names = list(dict.fromkeys(data.group[data.split != "test"].tolist()))
    return names if len(names) > 1 else []


def can_calibrate(data: Dataset) -> bool:
    """Whether there are groups whose errors can tell how wide intervals must be."""
    return bool(len(apart(data)) or training_groups(data))


@dataclass(frozen=True, eq=False)
class Scale:
    """How large errors are expected to be, in N: base[a] + Σ_k weights[a, k] · |measure k, shifted|."""

    pipeline: IntegerPipeline
    measures: tuple[str, ...]
    limits: np.ndarray  # (K,)
    load_axis: int
    base: np.ndarray  # (axes,)
    weights: np.ndarray  # (axes, K)

    def scores(self, found: Result, data: Dataset, index: np.ndarray) -> np.ndarray:
        """Errors of what was found in the samples `index`, in units of their scale, (frames, axes)."""
        magnitudes = _magnitudes(self.pipeline, self.measures, self.limits, self.load_axis, found)
        return _errors(self.pipeline, found, data, index) / (self.base + magnitudes @ self.weights.T)

    def times(self, factors: np.ndarray) -> ForceInterval:
        """The interval whose half-widths are so many times, (axes,), as large; without useless measures."""
        raw = factors / self.pipeline.force_n_per_unit
        used = self.weights.any(axis=0)
        names = tuple(name for name, kept in zip(self.measures, used, strict=True) if kept)
        weights = self.weights[:, used] * raw[:, None]
        return ForceInterval.of_weights(names, self.limits[used], weights, self.base * raw, self.load_axis)


def scale_of(pipeline: IntegerPipeline, data: Dataset) -> Scale:
    """The scale of the errors in the training split, where half of the frames have a drift that the limits of
    frame validity leave unseen."""
    validity, axes = pipeline.validity, pipeline.scene.force_axes
    largest = dict(zip(validity.names, validity.bounds[1], strict=True))
    names = [n for n in validity.names if n.startswith("brightness") or n in ("change", "gradient")]
    limits = np.array([int(largest[name]) for name in names] + [pipeline.force_bound], np.int64)
    measures = (*names, LOAD)
    load_axis = axes.index(NORMAL_AXIS) if NORMAL_AXIS in axes else 0
    emulator = Emulator(pipeline)
    seen = evenly_spaced(data.indices("train"), FITTED_FRAMES)
    frames = data.frames[seen]
    moved = drifted(frames, pipeline.background, validity, pipeline.scene.training.seed)
    runs = [emulator.run(images, wanted=WANTED) for images in (frames, moved)]
    magnitudes = np.concatenate([_magnitudes(pipeline, measures, limits, load_axis, run) for run in runs])
    errors = np.concatenate([_errors(pipeline, run, data, seen) for run in runs])
    fitted = [conformal.linear_scale(magnitudes, of_axis) for of_axis in errors.T]
    base, weights = (np.array(values) for values in zip(*fitted, strict=True))
    return Scale(pipeline, measures, limits, load_axis, base, weights)


def _magnitudes(
    pipeline: IntegerPipeline, measures: tuple[str, ...], limits: np.ndarray, load_axis: int, found: Result
) -> np.ndarray:
    """|measures| (frames, K) as `ForceInterval` takes them."""
    columns = [pipeline.validity.names.index(name) for name in measures[:-1]]
    values = np.column_stack([found.validity_measures[:, columns], found.force_raw[:, load_axis]])
    return np.abs(values >> shifts_of(limits))


def _errors(pipeline: IntegerPipeline, found: Result, data: Dataset, index: np.ndarray) -> np.ndarray:
    return np.abs(found.force_n - data.forces_n(index, pipeline.scene.force_axes))


def held_out_scores(pipeline: IntegerPipeline, data: Dataset, index: np.ndarray) -> np.ndarray:
    """Scores (frames, axes) of the samples `index`, with the scale of the training split's errors."""
    return scale_of(pipeline, data).scores(
        Emulator(pipeline).run(data.frames[index], wanted=WANTED), data, index
    )


def calibrated(
    pipeline: IntegerPipeline, data: Dataset, left_out: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[IntegerPipeline, dict]:
    """The integers with intervals around their forces, and what these hold and follow from.

    How widths depend on the measures follows from the training split, see `scale_of`; how wide they are from
    scores of groups that were not trained on, see `training/force/conformal.py`: those of the validation
    split or, where it has none, each training group's by models that were trained without it.

    left_out : scores (frames, axes) of training groups that models did not know, and these groups (frames,)

    Returned besides: "asked", the scene's coverage; "coverage", what the intervals are made for, which is
    less where there are too few groups; "groups" and "frames" of the scores; "trainings", how many trainings
    without one of the groups they follow from.
    """
    scale = scale_of(pipeline, data)
    if left_out is None:
        index = apart(data)
        found = Emulator(pipeline).run(data.frames[index], wanted=WANTED)
        scores, group = scale.scores(found, data, index), groups(data)[index]
    else:
        scores, group = left_out
    factors, about = _quantiles(scores, group, pipeline.scene.force.coverage)
    if left_out is not None:
        about["trainings"] = about["groups"]
    return pipeline.replace(interval=scale.times(factors)), about


def _quantiles(scores: np.ndarray, group: np.ndarray, asked: float) -> tuple[np.ndarray, dict]:
    """What the scores (frames, axes) of groups (frames,) do not exceed in the share `asked`, or in what so
    many groups support, (axes,); and what `calibrated` returns of that, without trainings."""
    count = len(np.unique(group))
    coverage = min(asked, conformal.supported(count))
    found = np.array([conformal.pooled_quantile(of_axis, group, coverage) for of_axis in scores.T])
    about = {"asked": asked, "coverage": coverage, "groups": count, "frames": len(group), "trainings": 0}
    return found, about


def widened(known: Bundle, pipeline: IntegerPipeline, data: Dataset) -> tuple[IntegerPipeline, dict, str]:
    """Another unit's pipeline with intervals as wide at least as before, that hold the forces on its presses.

    known : the first unit's bundle, which the intervals are of; data : the other unit's presses

    Each axis's width grows by the same amount in all frames, so that the first unit's hardware can load it:
    by the quantile over the presses of how far outside of its interval a force is. The unit's network has
    learned from the same presses, so that new ones may lie further outside.
    Returned besides: what the provenance says of intervals, as that of `calibrated`, and a line about it.
    """
    if pipeline.interval is None:
        return pipeline, {}, "none"
    axes, press = pipeline.scene.force_axes, presses(data)
    index = np.flatnonzero((data.split != "test") & (press != ""))
    if not data.has_force(axes):
        known_about = {k: v for k, v in known.pipeline.provenance.items() if k == INTERVAL}
        return pipeline, known_about, "as they were: the presses have no force"
    found = Emulator(pipeline).run(data.frames[index], wanted=(*WANTED, "force_half_width_n"))
    outside = _errors(pipeline, found, data, index) - found.force_half_width_n
    quantiles, about = _quantiles(outside, press[index], pipeline.scene.force.coverage)
    more_n = np.maximum(quantiles, 0.0)
    raw = np.ceil(more_n / pipeline.force_n_per_unit)  # half-widths are whole numbers
    base = pipeline.interval.base + np.ceil(raw / 2.0**pipeline.interval.exponent).astype(np.int64)
    shown = ", ".join(f"{'xyz'[a]} by {more:.4f} N" for a, more in zip(axes, more_n, strict=True))
    text = f"widened: {shown}; made for {100 * about['coverage']:.1f}% of presses, by {about['groups']}"
    return pipeline.replace(interval=replace(pipeline.interval, base=base)), {INTERVAL: about}, text
