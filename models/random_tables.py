"""Random weights of networks and forces, and random frames, for scenes whose models are not trained."""

from itertools import pairwise

import numpy as np

from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.features import integer_features, scales
from fastac.models.integer.force import block_means, terms
from fastac.models.integer.force_interval import (
    BASE_BITS,
    LOAD,
    OF_PIXELS,
    WEIGHT_BITS,
    ForceInterval,
    shifts_of,
)
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.quantise import quantise_layers
from fastac.scenes.model_schema import Numbers
from fastac.scenes.schema import Scene


def frames(background: np.ndarray, spans: tuple[int, ...], seed: int = 1) -> np.ndarray:
    """One random frame per entry of `spans`, uint8 (spans, H, W, C): background ± at most `span` per pixel.

    Larger spans give steeper slopes.
    """
    rng = np.random.default_rng(seed)
    changed = [background + rng.integers(-span, span + 1, background.shape) for span in spans]
    return np.clip(changed, 0, 255).astype(np.uint8)


def layers(
    bits: dict[str, int], background: np.ndarray, rng: np.random.Generator, hidden: tuple[int, ...]
) -> tuple[Layer, ...]:
    """A quantised network of random weights, with n_z > 0 so that its slopes do not saturate on small
    changes.

    bits : see `network_bits`; hidden : neurons of each hidden layer
    """
    channels = background.shape[-1]
    sizes = (channels + 2, *hidden, 3)
    weights = [rng.normal(size=(neurons, inputs)) / np.sqrt(inputs) for inputs, neurons in pairwise(sizes)]
    biases = [0.1 * rng.normal(size=neurons) for neurons in sizes[1:]]
    weights[-1][2] *= 0.2
    biases[-1][2] = 1.5
    pixels = integer_features(frames(background, (60, 60, 255)), background)
    return quantise_layers(
        weights,
        biases,
        scales(channels),
        pixels.reshape(-1, channels + 2).astype(np.int64),
        **bits,
    )


def network_bits(numbers: Numbers) -> dict[str, int]:
    """The words of a pixel network, as `quantise_layers` takes them."""
    return {
        "weight_bits": numbers.weight_bits,
        "activation_bits": numbers.activation_bits,
        "last_weight_bits": numbers.last_weight_bits,
    }


def force_weights(
    scene: Scene, rng: np.random.Generator, follower: DotFollower | None
) -> tuple[np.ndarray, ...]:
    """Random weights of the force, as `with_force` takes them."""
    axes, inner, size = len(scene.force_axes), scene.inner_px, scene.force.kernel_size
    shape = (inner, inner, size, size)
    if scene.force_from_slopes:
        shape = (scene.sensor.height_px, scene.sensor.width_px, 2)
    elif scene.force_of_weights:
        shape = (inner, inner, terms(np.zeros(()), scene.force.bends_mm).size)
    weights = block_means(rng.normal(size=(axes, *shape)), scene.force.block_px)
    if not scene.wants_dots:
        return (weights,)
    return weights, rng.normal(scale=10, size=(axes, len(follower.rest), 2))


def force_interval(pipeline: IntegerPipeline, rng: np.random.Generator) -> ForceInterval:
    """A random interval of all measures around the forces of a pipeline."""
    largest = dict(zip(pipeline.validity.names, pipeline.validity.bounds[1], strict=True))
    names = [name for name in largest if name in OF_PIXELS]
    limits = np.array([int(largest[name]) for name in names] + [pipeline.force_bound], np.int64)
    axes, count = len(pipeline.force_n_per_unit), len(limits)
    return ForceInterval(
        (*names, LOAD),
        limits,
        shifts_of(limits),
        rng.integers(1, 1 << WEIGHT_BITS, (axes, count)),
        rng.integers(0, 1 << BASE_BITS, axes),
        rng.integers(-12, 3, axes),
        load_axis=axes - 1,
    )
