import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork, predict
from fastac.models.training.pruning import hidden_neurons


def with_idle_neurons(network: PixelNetwork) -> PixelNetwork:
    """The same function with two more neurons in the second layer: one is always 0, one twice another."""
    wider = PixelNetwork(6, (8, 10, 8))
    with torch.no_grad():
        for new, old in zip(wider.linear_layers, network.linear_layers, strict=True):
            new.weight.zero_()
            new.bias.zero_()
            new.weight[: old.out_features, : old.in_features] = old.weight
            new.bias[: old.out_features] = old.bias
        second, third = wider.linear_layers[1:3]
        second.bias[8] = -1.0
        second.weight[9], second.bias[9] = 2 * second.weight[0], 2 * second.bias[0]
        third.weight[:, 9] = 0.3 * third.weight[:, 0]
        third.weight[:, 0] -= 2 * third.weight[:, 9]
    return wider


def features(count: int) -> np.ndarray:
    """Random integer features (pixels, 6)."""
    return np.random.default_rng(1).integers(-60, 60, (count, 6))


def test_neurons_that_add_nothing_go_at_no_cost():
    torch.manual_seed(1)
    network, x = PixelNetwork(6, (8, 8, 8)), features(3000)
    wider = with_idle_neurons(network)
    np.testing.assert_allclose(predict(wider, x), predict(network, x), atol=1e-5)
    hidden = hidden_neurons.outputs(wider, x)
    assert [values.shape for values in hidden] == [(3000, 8), (3000, 10), (3000, 8)]
    for neuron in (0, 8, 9):
        fewer = hidden_neurons.without_neuron(wider, 1, neuron, hidden[1])
        assert hidden_neurons.widths(fewer) == (8, 9, 8)
        np.testing.assert_allclose(predict(fewer, x), predict(network, x), atol=1e-4)


def test_a_layer_at_its_fewest_loses_none():
    network, x = PixelNetwork(6, (8, 10, 8)), features(100)
    for fewest, expected in (((4, 4, 4), [(7, 10, 8)] * 8 + [(8, 9, 8)] * 10 + [(8, 10, 7)] * 8),
                             ((8, 9, 8), [(8, 9, 8)] * 10), ((8, 10, 8), [])):  # fmt: skip
        found = hidden_neurons.candidates(network, x, fewest)
        assert [hidden_neurons.widths(candidate) for candidate in found] == expected
