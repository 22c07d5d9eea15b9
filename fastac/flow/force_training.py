"""The force model: trained on what the float pipeline finds, then fitted to what each pipeline finds."""

from pathlib import Path

import numpy as np

from fastac.flow.force_fits import FITS, ForceSamples
from fastac.flow.pipelines import dots_at_rest, float_pipeline, integer_pipeline, rest_depth_mm
from fastac.flow.training import curve
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import HyperForce
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.force import block_means
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.groups import groups, left_out_together
from fastac.store.files import load_arrays, save_arrays


def force(
    data: Dataset, scene: Scene, weights: Path, integers: Path, output: Path, *, progress: bool
) -> None:
    """Train the force model on what the float pipeline finds, then fit it to what each pipeline finds."""
    start, arrays = start_force(data, scene, load_arrays(weights), progress=progress)
    pipeline = Emulator(integer_pipeline(load_arrays(integers), data, scene))
    save_arrays(output, arrays | fit_force("integer", pipeline, data, start, progress=progress))


def start_force(
    data: Dataset, scene: Scene, weights: dict[str, np.ndarray], *, progress: bool
) -> tuple[HyperForce | None, dict[str, np.ndarray]]:
    """The force model that every pipeline's fit starts from, and the float pipeline's own fit as arrays.

    No model where the weights of the slopes are fitted directly.
    """
    samples = force_samples(float_pipeline(weights, data, scene), data, progress=progress)
    way = FITS[scene.force.fit]
    start, history = way.start(scene, samples, progress=progress)
    arrays = curve(history, "force") | _fit_force("float", scene, start, samples, progress=progress)
    return start, arrays | (dots_at_rest(data, scene) if scene.wants_dots else {})


def fit_force(
    name: str,
    pipeline: FloatPipeline | Emulator,
    data: Dataset,
    start: HyperForce | None,
    *,
    progress: bool,
) -> dict[str, np.ndarray]:
    """The force's weights for what a pipeline finds: `force.{name}_weights`, with dots
    `force.{name}_dot_weights`, and how they were chosen."""
    samples = force_samples(pipeline, data, progress=progress)
    return _fit_force(name, pipeline.scene, start, samples, progress=progress)


def force_samples(pipeline: FloatPipeline | Emulator, data: Dataset, *, progress: bool) -> ForceSamples:
    """What the pipeline finds for the force model, and the truth, on training and validation frames."""
    splits = {s: data.indices(s) for s in ("train", "validation") if len(data.indices(s))}
    way, together, recording = FITS[pipeline.scene.force.fit], groups(data), left_out_together(data)

    def shifts_px(index: np.ndarray) -> np.ndarray:
        return pipeline.run(data.frames[index], wanted=["dot_shifts_px"], progress=progress).dot_shifts_px

    return ForceSamples(
        found={
            split: way.force_input(pipeline, data.frames[index], data.background, progress=progress)
            for split, index in splits.items()
        },
        force_n={s: data.forces_n(index, pipeline.scene.force_axes) for s, index in splits.items()},
        shifts_px={s: shifts_px(index) for s, index in splits.items()} if pipeline.scene.wants_dots else None,
        recording={s: recording[index] for s, index in splits.items()},
        together={s: together[index] for s, index in splits.items()},
        rest_depth_mm=rest_depth_mm(data),
    )


def _fit_force(
    name: str, scene: Scene, start: HyperForce | None, samples: ForceSamples, *, progress: bool
) -> dict[str, np.ndarray]:
    fitted, of_dots, history = FITS[scene.force.fit].fit(scene, start, samples, progress=progress)
    # What squares make of these weights is what the fit has seen: Σ w · mean(x) = Σ mean(w) · x.
    fitted = block_means(fitted, scene.force.block_px)
    weights = {f"force.{name}_weights": fitted.astype(np.float32)}
    if of_dots is not None:
        weights[f"force.{name}_dot_weights"] = of_dots.astype(np.float32)
    return weights | curve(history, f"force_{name}")
