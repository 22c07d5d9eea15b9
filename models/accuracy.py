"""Accuracy against ground truth, with the units in the names."""

from dataclasses import replace

import numpy as np

from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset

LABEL_MARGIN_PX = 4
"""Original pixels inside a labelled contact circle that are left out: the label's own uncertainty."""


def _known(data: Dataset, index: np.ndarray) -> np.ndarray:
    shape = (len(index), *data.frames.shape[1:3])
    return np.ones(shape, bool) if data.valid is None else data.valid[index]


def normals(result: Result, data: Dataset, index: np.ndarray, pitch_mm: float) -> dict[str, float]:
    """Errors of normals and gradients over the pixels whose normal is known.

    The total gradient error is the sum of both components', as in the paper's table.
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
    """Mean gradient-angle error in rad inside labelled contact circles, background prediction subtracted.

    Per image the mean of |Δ atan p| and |Δ atan q| over the pixels inside the circle less LABEL_MARGIN_PX original
    pixels, then the mean over images. None where the dataset labels no circles.
    """
    errors = []
    for k, sample, inside, _ in _contacts(data, index):
        truth = data.normals[sample][inside].astype(np.float64)
        found = np.arctan(result.slopes[k][inside] - rest.slopes[0][inside])
        errors.append(np.abs(found - np.arctan(-truth[:, :2] / truth[:, 2:])).mean())
    return float(np.mean(errors)) if errors else None


def contact_depth_mae_mm(result: Result, data: Dataset, index: np.ndarray, pitch_mm: float) -> float | None:
    """Mean error of the depth's shape in mm inside labelled contact circles, against the ball's.

    Where the skin lies against the ball its height is −√(R² − r²) and a constant that nobody has measured, so
    the mean over the circle less LABEL_MARGIN_PX original pixels is taken from both. Then the mean over images. None
    where the dataset labels no circles of a known ball.
    """
    if data.indenter is None or "ball_mm" not in data.indenter:
        return None
    errors = []
    for k, sample, inside, distance_px in _contacts(data, index):
        under = (data.indenter["ball_mm"][sample] / 2) ** 2 - (distance_px * pitch_mm) ** 2
        difference = result.depth_mm[k][inside] + np.sqrt(under[inside])
        errors.append(np.abs(difference - difference.mean()).mean())
    return float(np.mean(errors)) if errors else None


def _contacts(data: Dataset, index: np.ndarray):
    """Of each labelled contact circle: place in `index`, sample, the known pixels inside it less LABEL_MARGIN_PX
    original pixels, and each pixel's distance from its centre in px."""
    if data.indenter is None or "radius_px" not in data.indenter or "scale" not in data.indenter:
        return
    v, u = np.indices(data.frames.shape[1:3])
    known = _known(data, index)
    for k, sample in enumerate(index):
        (centre_u, centre_v), radius = data.indenter["center_px"][sample], data.indenter["radius_px"][sample]
        if not np.isfinite(radius):
            continue
        distance = np.hypot(u - centre_u, v - centre_v)
        inside = known[k] & (distance <= radius - LABEL_MARGIN_PX / data.indenter["scale"][sample])
        if inside.any():
            yield k, sample, inside, distance


def depth_mae_mm(result: Result, data: Dataset, index: np.ndarray) -> float:
    """Mean absolute depth error over the inner pixels that are valid (the boundary is given, not found)."""
    known = _known(data, index)[:, 1:-1, 1:-1]
    error = np.abs(result.depth_mm - data.depth_mm[index])[:, 1:-1, 1:-1]
    return float(error[known].mean())


def force(result: Result, data: Dataset, index: np.ndarray, axes: tuple[int, ...]) -> dict[str, float]:
    """Errors of the force components `axes` (0, 1, 2 for x, y, z): their mean and, of several, each one's.

    Normalised by each component's largest true load, as in the paper. Without a load, or where all loads are
    the same, what would divide by zero is left out.
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
    """Every error whose ground truth the dataset has and whose output the scene wants."""
    found = {}
    known = _known(data, index)
    means_normals = scene.training.labels == "geometry"  # of forces alone the network learns other things
    if means_normals and data.normals is not None and known.any():
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
    """What runs frames with the dataset's own background: each recording is seen against its own rest.

    pipeline : a float pipeline, or the tables of an integer one
    """
    own = replace(pipeline, background=data.background)
    return Emulator(own) if isinstance(own, IntegerPipeline) else own


def compare_pipelines(
    bundle: Bundle, data: Dataset, index: np.ndarray, *, progress: bool
) -> tuple[dict, dict[str, Result]]:
    """Errors of both pipelines on frames `index`; returns {"float": …, "integer": …} and the results.

    "growth_percent" says by how much each error grows from float to integer.
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
