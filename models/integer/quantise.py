"""Post-training quantisation of the pixel network: float weights to integer layers and multipliers."""

from collections.abc import Sequence

import numpy as np

from fastac.models.integer.features import limits
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.rounding import neuron, refitted

MULTIPLIER_BITS = 17
FEWEST_ACTIVE = 1000
"""Calibration pixels on which a neuron must be active for these alone to fix its weights."""


def requantisation(scale: np.ndarray, bits: int) -> Requantisation:
    """`scale` (neurons,) > 0, activation units per accumulator unit, as multipliers and one shift.

    The largest multiplier uses all 17 bits; a shift below zero (scales of 2**17 and more) is refused.
    """
    shift = MULTIPLIER_BITS - int(np.floor(np.log2(scale.max()))) - 1
    multiplier = np.rint(scale * 2.0**shift).astype(np.int64)
    if multiplier.max() >> MULTIPLIER_BITS:
        shift -= 1
        multiplier = np.rint(scale * 2.0**shift).astype(np.int64)
    return Requantisation(np.maximum(multiplier, 1), shift, bits)


def quantise_layers(
    weights: Sequence[np.ndarray],
    biases: Sequence[np.ndarray],
    feature_scales: np.ndarray,
    features: np.ndarray,
    *,
    weight_bits: int,
    activation_bits: int,
    last_weight_bits: int,
    percentile: float = 100,
) -> tuple[Layer, ...]:
    """Post-training quantisation of the pixel network.

    weights, biases : of the float layers; feature_scales : float value of one unit of each integer feature
    features : calibration pixels (pixels, inputs), integers; activations' ranges are `percentile` of theirs

    Every hidden neuron has a weight scale and an activation range of its own: its multiplier and the next
    layer's weights absorb both. The last layer has one scale for all neurons, because only the ratios of its
    outputs count. Floors are turned into roundings by half a unit in the bias.
    """
    top_activation = (1 << activation_bits) - 1
    layers = []
    into = features.astype(np.float64) * feature_scales  # float activations
    unit = feature_scales  # float value of one integer unit of each input
    limit = limits(len(feature_scales) - 2)
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        out = np.maximum(into @ weight.T + bias, 0)
        activation_unit = _activation_unit(np.percentile(out, percentile, axis=0), top_activation)
        bias = bias + activation_unit / 2
        integer_weight, scale = _scaled(weight * unit, bias, limit, weight_bits, axis=1)
        integer_bias = np.rint(bias / scale).astype(np.int64)
        multiplier = requantisation(scale / activation_unit, activation_bits)
        layers.append(Layer(integer_weight, integer_bias, limit, weight_bits, multiplier))
        into, unit, limit = out, activation_unit, np.full(len(weight), top_activation)
    return (*layers, _last_layer(weights[-1] * unit, biases[-1], limit, last_weight_bits))


def compensated_layers(
    weights: Sequence[np.ndarray],
    biases: Sequence[np.ndarray],
    feature_scales: np.ndarray,
    features: np.ndarray,
    *,
    weight_bits: int,
    activation_bits: int,
    last_weight_bits: int,
) -> tuple[Layer, ...]:
    """`quantise_layers` whose roundings make up for each other on the calibration pixels.

    Layer by layer, weights and biases are fitted anew to the integers that the layers before really give, and
    rounded together (models/integer/rounding.py): of a hidden neuron over the pixels where it is active.
    """
    top_activation, top = (1 << activation_bits) - 1, (1 << (weight_bits - 1)) - 1
    layers = []
    into = features.astype(np.float64) * feature_scales  # float activations
    seen = features.astype(np.int64)  # what the integer layers give
    limit = limits(len(feature_scales) - 2)
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        sums = into @ weight.T + bias
        into = np.maximum(sums, 0)
        activation_unit = _activation_unit(into.max(axis=0), top_activation)
        bound = top * int(limit.sum())
        least = np.abs(sums).max() * 1e-4 / bound  # that a dead neuron's multiplier can express
        neurons = []
        for one in sums.T:
            active = one > 0
            if active.sum() < FEWEST_ACTIVE:
                active[:] = True
            inputs = seen[active].astype(np.float64)
            neurons.append(neuron(inputs, one[active], top=top, limit=int(limit.sum()), least=least))
        integer_weight, scale, bias = (np.array(part) for part in zip(*neurons, strict=True))
        integer_bias = np.clip(np.rint((bias + activation_unit / 2) / scale), -bound, bound).astype(np.int64)
        multiplier = requantisation(scale / activation_unit, activation_bits)
        layers.append(Layer(integer_weight, integer_bias, limit, weight_bits, multiplier))
        seen, limit = layers[-1](seen), np.full(len(weight), top_activation)
    weight, bias = refitted(seen.astype(np.float64), into @ weights[-1].T + biases[-1])
    return (*layers, _last_layer(weight, bias, limit, last_weight_bits))


def least_range(largest):
    """The range that a neuron which is all but dead has of its activations, a thousandth of the most active
    one's; from the largest activation of each, an array or a tensor (neurons,)."""
    return largest.max() * 1e-3 + 1e-9


def _activation_unit(largest: np.ndarray, top: int) -> np.ndarray:
    """Float value of one unit of each neuron's activation, (neurons,), whose largest value is `top` units."""
    return np.maximum(largest, least_range(largest)) / top


def _last_layer(weight: np.ndarray, bias: np.ndarray, limit: np.ndarray, bits: int) -> Layer:
    """The layer of float weights (neurons, inputs), in units of its integer inputs, with one scale for all
    neurons, because only the ratios of its outputs count."""
    integer_weight, scale = _scaled(weight, bias, limit, bits, axis=None)
    return Layer(integer_weight, np.rint(bias / scale).astype(np.int64), limit, bits)


def _scaled(
    weight: np.ndarray, bias: np.ndarray, limit: np.ndarray, bits: int, axis: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Weights (neurons, inputs) as integers of `bits`, and each neuron's scale; one for all if no axis.

    No bias (neurons,) is then larger than the weights could make the sum over inputs up to `limit`: so much
    room a loadable one has.
    """
    top = (1 << (bits - 1)) - 1
    magnitude = np.abs(weight)
    largest = np.hstack([magnitude, np.abs(bias)[:, None] / limit.sum()])
    scale = largest.max(axis=axis, keepdims=True) / top
    # A neuron whose weights have died keeps a scale that its multiplier can express.
    scale = np.broadcast_to(np.maximum(scale, magnitude.max() * 1e-4 / top), (len(weight), 1))
    return np.clip(np.rint(weight / scale), -top, top).astype(np.int64), scale[:, 0]


def layers_to_arrays(layers: Sequence[Layer]) -> dict[str, np.ndarray]:
    """Layers as named arrays, for a file between two steps of a build."""
    arrays = {}
    for k, layer in enumerate(layers):
        arrays |= {f"layer.{k}.{name}": getattr(layer, name) for name in ("weight", "bias", "input_limit")}
        arrays[f"layer.{k}.weight_bits"] = np.array(layer.weight_bits)
        if layer.requantisation is not None:
            scale = layer.requantisation
            arrays[f"layer.{k}.multiplier"] = scale.multiplier
            arrays[f"layer.{k}.shift_bits"] = np.array([scale.shift, scale.bits])
    return arrays


def layers_from_arrays(arrays: dict[str, np.ndarray]) -> tuple[Layer, ...]:
    """The inverse of `layers_to_arrays`."""
    layers = []
    while f"layer.{len(layers)}.weight" in arrays:
        part = f"layer.{len(layers)}."
        scale = None
        if f"{part}multiplier" in arrays:
            scale = Requantisation(arrays[f"{part}multiplier"], *map(int, arrays[f"{part}shift_bits"]))
        layers.append(
            Layer(
                arrays[f"{part}weight"],
                arrays[f"{part}bias"],
                arrays[f"{part}input_limit"],
                int(arrays[f"{part}weight_bits"]),
                scale,
            )
        )
    return tuple(layers)
