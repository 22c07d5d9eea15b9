"""How many forces are within their intervals, on frames that nothing was learned or calibrated on."""

import numpy as np

from fastac.models.accuracy import with_background_of
from fastac.models.integer.force_interval import INTERVAL
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.models.training.drift import drifted
from fastac.models.training.force.conformal import group_weights, wilson
from fastac.scenes.schema import AXES
from fastac.sensor.groups import groups
from fastac.sensor.samples import Dataset

DRIFT_SEED = 2
WANTED = ("force_n", "force_half_width_n", "validity")


def evaluate(pipeline: IntegerPipeline, data: Dataset, index: np.ndarray, *, progress: bool = False) -> dict:
    """Coverage and widths of a pipeline's intervals on the samples `index`, as they are and drifted.

    Beside what the intervals are made for, the result has, under "as_they_are" and "drifted", what `covered`
    finds. Drifts are those that the limits of frame validity leave unseen (`training/drift.py`); frames that
    are flagged do not count there.
    """
    emulator = with_background_of(pipeline, data)
    frames = data.frames[index]
    moved = drifted(frames, data.background, pipeline.validity, DRIFT_SEED)
    kept, after = (emulator.run(images, wanted=WANTED, progress=progress) for images in (frames, moved))
    axes = pipeline.scene.force_axes
    found = {**pipeline.provenance.get(INTERVAL, {}), "as_they_are": covered(kept, data, index, axes)}
    good = after.validity == 0
    if good.any():
        found["drifted"] = covered(after, data, index, axes, good)
    return found


def covered(
    result: Result,
    data: Dataset,
    index: np.ndarray,
    axes: tuple[int, ...],
    chosen: np.ndarray | None = None,
) -> dict:
    """How many true forces of the samples `index` (or of those `chosen` of them) are within their intervals.

    Returns "groups", "frames", and by axis ("z") the "coverage", in which each group has the same weight, its
    95% confidence interval "coverage_from" and "coverage_to" (Wilson's, with as many independent trials as
    the spread between groups shows), and the mean "half_width_n".
    """
    chosen = np.ones(len(index), bool) if chosen is None else chosen
    group = groups(data)[index][chosen]
    error = np.abs(result.force_n - data.forces_n(index, axes))[chosen]
    half = result.force_half_width_n[chosen]
    weights = group_weights(group)
    found = {"groups": len(np.unique(group)), "frames": int(chosen.sum())}
    for k, axis in enumerate(axes):
        inside = (error[:, k] <= half[:, k]).astype(float)
        share = min(float(weights @ inside), 1.0)
        low, high = wilson(share, _trials(inside, group))
        found[AXES[axis]] = {
            "coverage": share,
            "coverage_from": low,
            "coverage_to": high,
            "half_width_n": float(weights @ half[:, k]),
        }
    return found


def _trials(inside: np.ndarray, group: np.ndarray) -> float:
    """How many independent trials have as large a standard error as the mean of the groups' shares has; from
    the number of groups to that of frames."""
    _, place, sizes = np.unique(group, return_inverse=True, return_counts=True)
    count, shares = len(sizes), np.bincount(place, inside) / sizes
    spread = float(shares.var(ddof=1)) if count > 1 else 0.0
    if spread == 0:
        return count
    mean = float(shares.mean())
    return float(np.clip(count * mean * (1 - mean) / spread, count, len(group)))


def lines(found: dict) -> list[str]:
    """What `evaluate` found, to print."""
    asked = f"{100 * found['asked']:g}% asked" if "asked" in found else "forces"
    said = []
    for name, label in (("as_they_are", "intervals"), ("drifted", "under drift")):
        for axis, entry in found.get(name, {}).items():
            if axis in AXES:
                said.append(
                    f"{label}, force_{axis}: {100 * entry['coverage']:.1f}% within"
                    f" (95% confidence {100 * entry['coverage_from']:.1f} to"
                    f" {100 * entry['coverage_to']:.1f}%, {found[name]['groups']} groups;"
                    f" {asked}), ± {entry['half_width_n']:.4g} N in the mean"
                )
    return said


def remark(pipeline: IntegerPipeline) -> str | None:
    """One line where the intervals hold less than the scene asks; None where they do not."""
    about = pipeline.provenance.get(INTERVAL)
    if about is None or about["coverage"] >= about["asked"]:
        return None
    return (
        f"force.coverage = {about['asked']:g}: {about['groups']} groups support at most"
        f" {100 * about['coverage']:.1f}%, which the intervals are made for: as wide as the worst frame asks"
    )
