"""Float and integer pipelines of a dataset, from the arrays that the steps of a training write."""

import numpy as np

from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer import assemble as integer_assemble
from fastac.models.integer import quantise
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.vision.dots import detected_as, follower_of, slope_bridge
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset


def rest_depth_mm(data: Dataset) -> np.ndarray:
    """The skin at rest, (H, W); where a dataset knows none, rest is the zero of depth, as for a flat gel."""
    if data.rest_depth_mm is not None:
        return data.rest_depth_mm.astype(np.float64)
    return np.zeros(data.frames.shape[1:3])


def float_pipeline(arrays: dict[str, np.ndarray], data: Dataset, scene: Scene) -> FloatPipeline:
    """The float pipeline up to the displacement, from what `normals` wrote; together with what `force` wrote
    up to the force."""
    if scene.wants_dots:
        arrays = dots_at_rest(data, scene) | arrays
    return FloatPipeline.from_arrays(
        arrays, scene, data.background, rest_depth_mm(data), slope_bridge(data.background, scene)
    )


def dots_at_rest(data: Dataset, scene: Scene) -> dict[str, np.ndarray]:
    """Where the detector sees the dots in the background, in the order in which the hardware follows them."""
    follower = follower_of(data.background, scene.sensor)
    return {"dots.rest_px": detected_as(follower, data.background, scene.sensor).rest_px}


def integer_pipeline(arrays: dict[str, np.ndarray], data: Dataset, scene: Scene) -> IntegerPipeline:
    """The integers up to the displacement and the dots' shifts, from what `integers` wrote."""
    return layers_pipeline(quantise.layers_from_arrays(arrays), data, scene)


def layers_pipeline(
    layers: tuple[Layer, ...], data: Dataset, scene: Scene, rest_mm: np.ndarray | None = None
) -> IntegerPipeline:
    """The integers up to the displacement and the dots' shifts.

    rest_mm : depth (H, W) of the skin at rest; None: the dataset's
    """
    return integer_assemble.assemble(
        scene,
        bridge=slope_bridge(data.background, scene),
        follower=follower_of(data.background, scene.sensor) if scene.wants_dots else None,
        layers=layers,
        background=data.background,
        rest_depth_mm=rest_depth_mm(data) if rest_mm is None else rest_mm,
    )


def with_fitted_force(pipeline: IntegerPipeline, fitted: dict[str, np.ndarray]) -> IntegerPipeline:
    """The integers with the weights that `fit_force` found for them."""
    weights = [fitted["force.integer_weights"]]
    if pipeline.scene.wants_dots:
        weights.append(fitted["force.integer_dot_weights"])
    return integer_assemble.with_force(pipeline, *(values.astype(np.float64) for values in weights))
