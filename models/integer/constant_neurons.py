"""Hidden neurons whose output never changes: integer layers without them, and with others in their place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fastac.models.integer.network import Layer
from fastac.scenes.model_schema import FEWEST_NEURONS

CHUNK_PX = 1 << 16


def activation_ranges(layers: Sequence[Layer], features: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Smallest and largest output of each hidden neuron over features (pixels, inputs), by layer."""
    ranges = []
    for start in range(0, len(features), CHUNK_PX):
        x = features[start : start + CHUNK_PX].astype(np.int64)
        for k, layer in enumerate(layers[:-1]):
            x = layer(x)
            low, high = x.min(axis=0), x.max(axis=0)
            if start:
                low, high = np.minimum(low, ranges[k][0]), np.maximum(high, ranges[k][1])
                ranges[k] = low, high
            else:
                ranges.append((low, high))
    return ranges


def without_neurons(
    layers: Sequence[Layer], index: int, removed: np.ndarray, values: np.ndarray
) -> list[Layer]:
    """Layers without the neurons `removed` (indices) of hidden layer `index`, whose outputs are `values`.

    What they add to each sum of the next layer goes into its bias. Returns new layers.
    """
    found = list(layers)
    layer, following = found[index], found[index + 1]
    scale = layer.requantisation
    found[index] = replace(
        layer,
        weight=np.delete(layer.weight, removed, axis=0),
        bias=np.delete(layer.bias, removed),
        requantisation=replace(scale, multiplier=np.delete(scale.multiplier, removed)),
    )
    found[index + 1] = replace(
        following,
        weight=np.delete(following.weight, removed, axis=1),
        bias=following.bias + following.weight[:, removed] @ values,
        input_limit=np.delete(following.input_limit, removed),
    )
    return found


def without_constant(layers: Sequence[Layer], features: np.ndarray) -> tuple[Layer, ...]:
    """The layers without hidden neurons whose output is the same for all features (pixels, inputs).

    The result is the same to the bit wherever those neurons' outputs are what they are for these features. A
    layer keeps FEWEST_NEURONS at least, and a neuron stays where a bias would become larger than a loadable
    one may be.
    """
    found = list(layers)
    for index, (low, high) in enumerate(activation_ranges(layers, features)):
        # Last first, so that the indices of those before stay the same.
        for neuron in np.flatnonzero(low == high)[::-1]:
            if len(found[index].weight) <= FEWEST_NEURONS:
                break
            fewer = without_neurons(found, index, np.array([neuron]), low[[neuron]])
            following = fewer[index + 1]
            if np.abs(following.bias).max() <= following.bias_limit:
                found = fewer
    return tuple(found)


def with_hidden(layers: Sequence[Layer], hidden: Sequence[int]) -> tuple[Layer, ...]:
    """The layers with `hidden` neurons in each hidden layer: those added say 0 and count for nothing.

    So hardware with more neurons computes what the layers do. Raises ValueError where a layer has more.
    """
    found = list(layers)
    if len(hidden) != len(found) - 1 or any(len(a.weight) > n for a, n in zip(found, hidden, strict=False)):
        own = [len(layer.weight) for layer in found[:-1]]
        raise ValueError(f"hidden neurons {own}: expected at most {list(hidden)}")
    for index, neurons in enumerate(hidden):
        layer, following = found[index], found[index + 1]
        more, scale = neurons - len(layer.weight), layer.requantisation
        found[index] = replace(
            layer,
            weight=np.pad(layer.weight, ((0, more), (0, 0))),
            bias=np.pad(layer.bias, (0, more)),
            requantisation=replace(scale, multiplier=np.pad(scale.multiplier, (0, more), constant_values=1)),
        )
        found[index + 1] = replace(
            following,
            weight=np.pad(following.weight, ((0, 0), (0, more))),
            input_limit=np.pad(following.input_limit, (0, more), constant_values=(1 << scale.bits) - 1),
        )
    return tuple(found)
