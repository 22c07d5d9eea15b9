"""Hidden neurons of the float pixel network: their outputs, and the network without one of them.

A neuron's outputs are replaced by the best linear combination of its layer's other outputs, which goes into
the next layer's weights and biases.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales


def outputs(network: PixelNetwork, x: np.ndarray) -> list[np.ndarray]:
    """Each hidden layer's outputs (pixels, neurons) for features (pixels, inputs)."""
    found = []
    with torch.inference_mode():
        values = torch.from_numpy(x.astype(np.float32) * scales(x.shape[1] - 2).astype(np.float32))
        for layer in network.linear_layers[:-1]:
            values = torch.relu(layer(values))
            found.append(values.numpy().astype(np.float64))
    return found


def widths(network: PixelNetwork) -> tuple[int, ...]:
    """Neurons of each hidden layer."""
    return tuple(layer.out_features for layer in network.linear_layers[:-1])


def without_neuron(network: PixelNetwork, index: int, neuron: int, hidden: np.ndarray) -> PixelNetwork:
    """The network without one neuron of hidden layer `index`, whose outputs are `hidden` (pixels, all)."""
    others = np.delete(hidden, neuron, axis=1)
    known = np.column_stack([others, np.ones(len(others))])
    share, *_ = np.linalg.lstsq(known.T @ known, known.T @ hidden[:, neuron], rcond=1e-9)
    sizes = list(widths(network))
    sizes[index] -= 1
    found = PixelNetwork(network.linear_layers[0].in_features, tuple(sizes))
    kept = [k for k in range(hidden.shape[1]) if k != neuron]
    with torch.no_grad():
        for k, (new, old) in enumerate(zip(found.linear_layers, network.linear_layers, strict=True)):
            weight, bias = old.weight, old.bias
            if k == index:
                weight, bias = weight[kept], bias[kept]
            elif k == index + 1:
                column = weight[:, neuron]
                bias = bias + column * float(share[-1])
                weight = weight[:, kept] + torch.outer(column, torch.tensor(share[:-1], dtype=weight.dtype))
            new.weight.copy_(weight)
            new.bias.copy_(bias)
    return found


def candidates(network: PixelNetwork, x: np.ndarray, fewest: Sequence[int]) -> Iterator[PixelNetwork]:
    """The network without one neuron, for every hidden neuron of a layer with more than its `fewest`.

    x : features (pixels, inputs) from which the linear combinations are found
    """
    for index, (hidden, least) in enumerate(zip(outputs(network, x), fewest, strict=True)):
        for neuron in range(hidden.shape[1] if hidden.shape[1] > least else 0):
            yield without_neuron(network, index, neuron, hidden)
