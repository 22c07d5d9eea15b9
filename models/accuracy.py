"""Errors of a pipeline's outputs against a dataset's ground truth; every key of a result names its unit."""

from dataclasses import replace

import numpy as np

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.scenes.schema import Scene
from fastac.sensor.contact_circle import contact_circle, is_whole
from fastac.sensor.dataset import Dataset

LABEL_MARGIN_PX = 4
"""Width of the ring inside a labelled contact circle that is not evaluated, in pixels of the original image:
the uncertainty of the label."""


def _known(data: Dataset, index: np.ndarray) -> np.ndarray:
    shape = (len(index), *data.frames.shape[1:3])
    return np.ones(shape, bool) if data.valid is None else data.valid[index]


def normals(result: Result, data: Dataset, index: np.ndarray, pitch_mm: float) -> dict[str, float]:
    """Mean absolute errors of gradients (mm/px) and normals (deg) over the pixels whose normal is known.

    index : the dataset's samples that `result` holds, (frames,)
    The total gradient error is the sum of both components' errors, as in the paper's table.
    """
    known = _known(data, index)
    truth = data.normals[index][known].astype(np.float64)
    slopes = -truth[:, :2] / truth[:, 2:]
    error = np.abs(result.slopes[known] - slopes).mean(axis=0) * pitch_mm
    cosine = np.clip((result.normals[known] * truth).sum(axis=-1), -1, 1)
    return {
        "gradient_x_mae_mm_per_px": float(error[0]),
        "gradient_y_mae_mm_per_px": float(error[1]),
        "gradient_mae_mm_per_px": float(error.sum()),
        "normal_mae_deg": float(np.degrees(np.arccos(cosine)).mean()),
    }


def contact_gradient_angle_rad(
    result: Result, rest: Result, data: Dataset, index: np.ndarray
) -> float | None:
    """Mean gradient-angle error in rad inside labelled contact circles.

    rest : the pipeline's result for the background frame; its slopes are subtracted from the predicted ones
    Per image the mean of |Δ atan p| and |Δ atan q| over the pixels inside the circle, less a ring of
    LABEL_MARGIN_PX original pixels; then the mean over images. None where the dataset labels no circles.
    """
    errors = []
    for k, sample, inside, _ in _contacts(data, index):
        truth = data.normals[sample][inside].astype(np.float64)
        found = np.arctan(result.slopes[k][inside] - rest.slopes[0][inside])
        errors.append(np.abs(found - np.arctan(-truth[:, :2] / truth[:, 2:])).mean())
    return float(np.mean(errors)) if errors else None


def contact_depth_mae_mm(result: Result, data: Dataset, index: np.ndarray, pitch_mm: float) -> float | None:
    """Mean error of the depth's shape, in mm, inside labelled contact circles, against the ball's surface.

    Where the skin lies against a ball of radius R its height is −√(R² − r²) plus a constant that was not
    measured. So each image's mean difference over the circle, less a ring of LABEL_MARGIN_PX original pixels,
    is subtracted before the absolute error is averaged; then the mean over images. Circles that reach beyond
    the photograph do not count. None where the dataset labels no whole contact circles of a ball of known
    diameter.
    """
    if data.indenter is None or "ball_mm" not in data.indenter:
        return None
    errors = []
    for k, sample, inside, distance_px in _contacts(data, index):
        if not is_whole(data, sample):
            continue
        under = (data.indenter["ball_mm"][sample] / 2) ** 2 - (distance_px * pitch_mm) ** 2
        difference = result.depth_mm[k][inside] + np.sqrt(under[inside])
        errors.append(np.abs(difference - difference.mean()).mean())
    return float(np.mean(errors)) if errors else None


def _contacts(data: Dataset, index: np.ndarray):
    """Yield, for each labelled contact circle, its position in `index`, its sample, the evaluated pixels and
    the distances from its centre.

    The evaluated pixels, (H, W) bool, are the known ones inside the circle less a ring of LABEL_MARGIN_PX
    original pixels; distances are (H, W) in px.
    """
    if data.indenter is None or "scale" not in data.indenter:
        return
    known = _known(data, index)
    for k, sample in enumerate(index):
        circle = contact_circle(data, sample)
        if circle is None:
            continue
        distance, radius = circle
        inside = known[k] & (distance <= radius - LABEL_MARGIN_PX / data.indenter["scale"][sample])
        if inside.any():
            yield k, sample, inside, distance


def depth_mae_mm(result: Result, data: Dataset, index: np.ndarray) -> float:
    """Mean absolute depth error in mm over the valid inner pixels (the boundary is the solver's input)."""
    known = _known(data, index)[:, 1:-1, 1:-1]
    error = np.abs(result.depth_mm - data.depth_mm[index])[:, 1:-1, 1:-1]
    return float(error[known].mean())


def force(result: Result, data: Dataset, index: np.ndarray, axes: tuple[int, ...]) -> dict[str, float]:
    """Errors of the force components `axes` (0, 1, 2 for x, y, z): MAE, RMSE, normalised MAE and R².

    With several axes each component's own errors are added. The normalised MAE divides by each component's
    largest true load, as in the paper. Figures whose denominator is zero (no load, or all loads equal) are
    left out.
    """
    truth = data.forces_n(index, axes).astype(np.float64)
    error = result.force_n - truth
    largest = np.abs(truth).max(axis=0)
    mae = np.abs(error).mean(axis=0)
    total = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    found = {"force_mae_n": float(mae.mean()), "force_rmse_n": float(np.sqrt((error**2).mean()))}
    if largest.all():
        found["force_nmae_percent"] = float((100 * mae / largest).mean())
    if total.all():
        found["force_r2"] = float((1 - (error**2).sum(axis=0) / total).mean())
    if len(axes) > 1:
        for k, axis in enumerate(axes):
            found[f"force_{'xyz'[axis]}_mae_n"] = float(mae[k])
            if largest[k]:
                found[f"force_{'xyz'[axis]}_nmae_percent"] = float(100 * mae[k] / largest[k])
    return found


def evaluate(
    result: Result, rest: Result, data: Dataset, index: np.ndarray, scene: Scene
) -> dict[str, float]:
    """Every error whose ground truth the dataset has and whose output the scene wants, as {key: value}.

    rest : the pipeline's result for the background frame
    index : the dataset's samples that `result` holds, (frames,)
    """
    found = {}
    known = _known(data, index)
    if scene.finds_normals and data.normals is not None and known.any():
        found |= normals(result, data, index, scene.sensor.pitch_mm)
        angle = contact_gradient_angle_rad(result, rest, data, index)
        if angle is not None:
            found["contact_gradient_angle_mae_rad"] = angle
    if result.depth_mm is not None and data.depth_mm is not None and known[:, 1:-1, 1:-1].any():
        found["depth_mae_mm"] = depth_mae_mm(result, data, index)
    if result.depth_mm is not None:
        shape = contact_depth_mae_mm(result, data, index, scene.sensor.pitch_mm)
        if shape is not None:
            found["contact_depth_mae_mm"] = shape
    if result.force_n is not None and data.has_force(scene.force_axes):
        found |= force(result, data, index, scene.force_axes)
    return found


def with_background_of(pipeline, data: Dataset):
    """The pipeline with its background replaced by the dataset's, so that frames meet the reference of their
    own recording.

    pipeline : a `FloatPipeline`, or an `IntegerPipeline`, whose `Emulator` is returned
    """
    own = replace(pipeline, background=data.background)
    return Emulator(own) if isinstance(own, IntegerPipeline) else own


def compare_pipelines(
    bundle: Bundle, data: Dataset, index: np.ndarray, *, progress: bool
) -> tuple[dict, dict[str, Result]]:
    """Errors of the float and of the integer pipeline on the dataset's samples `index`.

    Returns a dictionary and the results by name. The dictionary has the errors under "float" and "integer",
    each error's growth from float to integer under "growth_percent", and under "saturated_values" how many
    integer values saturated.
    """
    pipelines = {
        "float": with_background_of(FloatPipeline.from_bundle(bundle), data),
        "integer": with_background_of(bundle.pipeline, data),
    }
    results = {name: p.run(data.frames[index], progress=progress) for name, p in pipelines.items()}
    errors = {
        name: evaluate(result, pipelines[name].run(data.background[None]), data, index, bundle.scene)
        for name, result in results.items()
    }
    growth = {
        key: 100 * (errors["integer"][key] / value - 1)
        for key, value in errors["float"].items()
        if value and "_r2" not in key
    }
    saturated = {
        key: int(getattr(results["integer"], key).sum())
        for key in ("gradient_saturated", "displacement_saturated")
        if getattr(results["integer"], key) is not None
    }
    return {**errors, "growth_percent": growth, "saturated_values": saturated}, results
