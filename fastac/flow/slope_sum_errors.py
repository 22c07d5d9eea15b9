"""Errors by which pruned networks and digits are judged beside that of their slopes: depth and force."""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from fastac.flow.force_fits import slope_changes
from fastac.flow.pipelines import layers_pipeline, rest_depth_mm
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.network import Layer
from fastac.models.training.whole_frames.force_features import OfSlopes
from fastac.models.training.whole_frames.held_out_force import HeldOutForce
from fastac.models.training.whole_frames.network_depth import depth_mae_mm
from fastac.models.vision.dots import slope_bridge
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset


def network_errors(data: Dataset, scene: Scene) -> list[Callable[[PixelNetwork], float]]:
    """Of a float network: the mean absolute depth error in mm, where the scene finds depth and the dataset
    knows it."""
    index = _depth_frames(data, scene)
    if not len(index):
        return []
    known = {"rest_depth_mm": rest_depth_mm(data), "bridge": slope_bridge(data.background, scene)}
    return [lambda network: depth_mae_mm(network, data, scene, index, **known)]


def layers_errors(data: Dataset, scene: Scene) -> list[Callable[[Sequence[Layer]], float]]:
    """Of integer layers: that of `network_errors`; and the error of the force in N on the train split, as
    `HeldOutForce.error`, where the network has learned from a force of slopes."""
    found = []
    if len(index := _depth_frames(data, scene)):
        found.append(lambda layers: _layers_depth_mae_mm(layers, data, scene, index))
    if scene.learns_force_of_slopes:
        held_out = HeldOutForce.of(data, scene.force_axes, data.indices("train"))
        found.append(lambda layers: _layers_force_error_n(layers, data, scene, held_out))
    return found


def _depth_frames(data: Dataset, scene: Scene) -> np.ndarray:
    """The frames whose depth counts: those of the validation split or, without one, the training's; none
    where the scene finds no depth, or the dataset does not know it."""
    if not scene.wants_solver or data.depth_mm is None:
        return np.array([], int)
    index = data.indices("validation")
    return index if len(index) else data.indices("train")


def _layers_depth_mae_mm(layers: Sequence[Layer], data: Dataset, scene: Scene, index: np.ndarray) -> float:
    found = Emulator(layers_pipeline(tuple(layers), data, scene))
    return accuracy.depth_mae_mm(found.run(data.frames[index], wanted=["depth_mm"]), data, index)


def _layers_force_error_n(
    layers: Sequence[Layer], data: Dataset, scene: Scene, held_out: HeldOutForce
) -> float:
    found, learned = Emulator(layers_pipeline(tuple(layers), data, scene)), held_out.learned
    change = slope_changes(found, data.frames[learned], data.background, progress=False)
    features = OfSlopes(change.shape[1:3])(torch.from_numpy(change.astype(np.float32)))
    held_out.refit(features)
    return held_out.error(features, learned).item()
