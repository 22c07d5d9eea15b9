"""From a dataset to a bundle, in steps that can be resumed."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.flow import slope_sum_errors
from fastac.flow.intervals import calibrated, can_calibrate
from fastac.flow.pipelines import integer_pipeline, rest_depth_mm, with_fitted_force
from fastac.models.emulator import pipeline as emulator_pipeline
from fastac.models.floating.network import PixelNetwork
from fastac.models.integer import bundle, quantise
from fastac.models.integer.constant_neurons import without_constant
from fastac.models.integer.features import scales
from fastac.models.integer.force_interval import INTERVAL
from fastac.models.integer.network import Layer
from fastac.models.training import bit_true
from fastac.models.training import normals as train_normals
from fastac.models.training.force import from_forces
from fastac.models.training.labelled_pixels import labelled_splits
from fastac.models.training.moved_pixels import moved_or_chosen
from fastac.models.training.pruning.digits import fewer_digits
from fastac.models.training.pruning.prune import prune_neurons, prune_to_width
from fastac.models.training.whole_frames import force_least_squares, sums_of_slopes
from fastac.models.training.whole_frames.usable_frames import unknown_depth, whole_frames
from fastac.models.vision.dots import slope_bridge
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import load_arrays, save_arrays

CALIBRATION_PX = 1 << 17
"""Pixels that fix the ranges of the activations."""


class TrainingError(ValueError):
    """A dataset that cannot train what the scene wants."""


def require(data: Dataset, scene: Scene, path: Path) -> None:
    """Raise TrainingError where the dataset lacks what the scene's outputs are trained from."""
    by_geometry = scene.training.labels == "geometry"
    if by_geometry and data.normals is None:
        raise TrainingError(
            f"{path}: normals: missing, and scene {scene.name} trains the pixel network on them"
        )
    if scene.wants_force and data.force_n is None:
        raise TrainingError(f"{path}: force_n: missing, and scene {scene.name} wants {scene.outputs}")
    for axis in scene.force_axes:
        if not data.has_force((axis,)):
            raise TrainingError(
                f"{path}: force_n: no {'xyz'[axis]} axis, and scene {scene.name} wants {scene.outputs}"
            )
    if scene.training.depth_weight and (lack := unknown_depth(data)):
        raise TrainingError(f"{path}: {lack}")
    curved = scene.sensor.geometry == "fingertip"
    if by_geometry and curved and scene.wants_slopes and data.rest_depth_mm is None:
        raise TrainingError(f"{path}: rest_depth_mm: missing, and a curved skin needs its boundary prior")
    for split in ("train", "test"):
        if not len(data.indices(split)):
            raise TrainingError(f"{path}: split: no frame is in {split!r}")
    if scene.wants_interval and not can_calibrate(data):
        raise TrainingError(
            f"{path}: split: no press is in 'validation' alone, and scene {scene.name} has force.coverage"
        )


def curve(history: list[dict], name: str) -> dict[str, np.ndarray]:
    """A learning curve as arrays under `history.name.…`."""
    keys = history[0] if history else {}
    return {f"history.{name}.{key}": np.array([entry[key] for entry in history]) for key in keys}


def normals(data: Dataset, scene: Scene, output: Path, *, progress: bool) -> None:
    """Train the float pixel network, prune it and train it on with depth and force where the scene asks;
    writes its arrays and learning curves."""
    pixel_network(data, scene, output, progress=progress)
    if scene.training.learns_sums:
        on_sums(data, scene, output, output, progress=progress)


def pixel_network(data: Dataset, scene: Scene, output: Path, *, progress: bool) -> None:
    """Train the float pixel network on normals, or on forces alone, and prune it where the scene asks; writes
    its arrays and its learning curve."""
    if scene.training.labels == "force":
        network, history = from_forces.train(data, scene, progress=progress)
    else:
        skin = skin_alone(data, scene)
        network, history = train_normals.train(
            skin,
            scene.training,
            scene.network.trained,
            smoothing_px=scene.network.smoothing_px,
            rounding_bits=scene.felt_rounding_bits,
            progress=progress,
        )
        network = pruned(network, skin, data, scene, progress=progress)
    save_arrays(output, network.arrays | curve(history, "normals"))


def on_sums(data: Dataset, scene: Scene, weights: Path, output: Path, *, progress: bool) -> None:
    """Train the network that `pixel_network` wrote on, as `learn_sums`; writes its arrays and all learning
    curves."""
    arrays = load_arrays(weights)
    network = PixelNetwork.from_arrays(arrays)
    curves = learn_sums(network, data, skin_alone(data, scene), scene, progress=progress)
    save_arrays(output, arrays | network.arrays | curves)


def learn_sums(
    network: PixelNetwork, data: Dataset, skin: Dataset, scene: Scene, *, progress: bool = False
) -> dict[str, np.ndarray]:
    """Train the network on for the depth or the force, too, where the scene has `training.depth_weight` or
    `training.force_weight`, and then for the force alone, where it has `training.force_steps`; it is changed
    itself. Returns the learning curves. `skin` is what `skin_alone` leaves of the dataset."""
    settings, curves = scene.training, {}
    if not settings.learns_sums:
        return curves
    known = whole_frames(data, skin, scene, rest_depth_mm(data))
    if settings.depth_weight or settings.force_weight:
        curves |= curve(sums_of_slopes.train(network, known, progress=progress), "sums")
    if settings.force_steps:
        curves |= curve(force_least_squares.train(network, known, progress=progress), "force_alone")
    return curves


def pruned(
    network: PixelNetwork, skin: Dataset, data: Dataset, scene: Scene, *, progress: bool
) -> PixelNetwork:
    """The network with as many hidden neurons as the scene says or, where it gives a limit, as its errors
    allow; `skin` is what `skin_alone` leaves of the dataset."""
    if scene.network.train_width is None and scene.network.prune is None:
        return network
    pixels = labelled_splits(skin, scene.training, scene.network.smoothing_px)
    if scene.network.train_width is not None:
        return prune_to_width(
            network,
            pixels,
            scene.training,
            width=scene.network.hidden,
            slope_limit=scene.numbers.slope_limit,
            rounding_bits=scene.felt_rounding_bits,
            progress=progress,
        )
    return prune_neurons(
        network,
        pixels,
        scene.training,
        growth=scene.network.prune,
        slope_limit=scene.numbers.slope_limit,
        further_errors=slope_sum_errors.network_errors(data, scene),
        rounding_bits=scene.felt_rounding_bits,
        progress=progress,
    )


def skin_alone(data: Dataset, scene: Scene) -> Dataset:
    """The dataset without the normals of pixels whose slopes are bridged, and of those that
    `training.still_share` leaves out."""
    bridge, share = slope_bridge(data.background, scene), scene.training.still_share
    if data.normals is None:
        return data
    kept = []
    if bridge is not None:
        kept.append(np.stack([~bridge.dark(frame) for frame in data.frames]))
    if share < 1:
        kept.append(moved_or_chosen(data, scene.sensor, share, scene.training.seed))
    if data.valid is not None:
        kept.append(data.valid)
    return replace(data, valid=np.logical_and.reduce(kept)) if kept else data


def quantised(network: PixelNetwork, x: np.ndarray, scene: Scene) -> tuple[Layer, ...]:
    """The network's layers in the scene's words; features x (pixels, inputs) fix the activations' ranges."""
    chosen = np.random.default_rng(scene.training.seed).permutation(len(x))[:CALIBRATION_PX]
    return quantise.compensated_layers(
        [layer.weight.detach().numpy() for layer in network.linear_layers],
        [layer.bias.detach().numpy() for layer in network.linear_layers],
        scales(x.shape[1] - 2),
        x[chosen],
        weight_bits=scene.numbers.weight_bits,
        activation_bits=scene.numbers.activation_bits,
        last_weight_bits=scene.numbers.last_weight_bits,
    )


def integers(data: Dataset, scene: Scene, weights: Path, output: Path, *, progress: bool) -> None:
    """Quantise the pixel network and fine-tune it bit-true; writes the integer layers."""
    network = PixelNetwork.from_arrays(load_arrays(weights))
    if scene.training.labels == "force":
        split = from_forces.distillation_pixels(
            network, data, smoothing_px=scene.network.smoothing_px, seed=scene.training.seed
        )
    else:
        split = labelled_splits(skin_alone(data, scene), scene.training, scene.network.smoothing_px)
    x, _ = split["train"]
    layers = quantised(network, x, scene)
    layers, history = bit_true.finetune(split, layers, network, scene.training, progress=progress)
    if scene.network.prune is not None:
        if scene.hardware.weights == "baked":
            layers = fewer_digits(
                split,
                layers,
                network,
                scene.training,
                growth=scene.network.prune,
                slope_limit=scene.numbers.slope_limit,
                further_errors=slope_sum_errors.layers_errors(data, scene),
                progress=progress,
            )
        if scene.network.train_width is None:  # else the width stays the scene's
            layers = without_constant(layers, x)
    save_arrays(output, quantise.layers_to_arrays(layers) | curve(history, "finetune"))


def assemble(
    data: Dataset,
    scene: Scene,
    floats: dict[str, np.ndarray],
    integer: dict[str, np.ndarray],
    kernels: dict[str, np.ndarray],
    output: Path,
    left_out: tuple[np.ndarray, np.ndarray] | None = None,
) -> bundle.Bundle:
    """All integers and the float weights as a bundle, from what `normals`, `integers` and `force` wrote.

    kernels : the arrays of `force`; empty where the scene wants none
    left_out : as in `intervals.calibrated`, where intervals are not calibrated on the validation split
    """
    pipeline = integer_pipeline(integer, data, scene)
    floats = floats | {k: v for k, v in integer.items() if k.startswith("history.")}
    if scene.wants_force:
        pipeline = with_fitted_force(pipeline, kernels)
        floats |= kernels
    known = np.sort(np.concatenate([data.indices(split) for split in ("train", "validation")]))
    pipeline = emulator_pipeline.with_limits(pipeline, data.frames[known])
    about = provenance(data)
    if scene.wants_interval:
        pipeline, about[INTERVAL] = calibrated(pipeline, data, left_out)
    return bundle.save(output, replace(pipeline, provenance=about), floats)


def provenance(data: Dataset) -> dict:
    """What a bundle remembers of the frames that it was trained on."""
    source = {"source": data.source, "frames": len(data), "channels": list(data.channels)}
    if data.photograph_px is not None:
        source["photograph_px"] = list(data.photograph_px)
    return source
