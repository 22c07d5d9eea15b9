from dataclasses import replace

import numpy as np
import pytest

from fastac.models.integer.constant_neurons import with_hidden, without_constant
from fastac.models.integer.network import Layer, Requantisation
from fastac.scenes.model_schema import FEWEST_NEURONS

TOP = 127


def network(seed: int, *, still: dict[tuple[int, int], int]) -> list[Layer]:
    """Random layers of 7, 6 and 3 neurons for 5 inputs; `still`: by layer and neuron a bias that is so far
    from what the weights reach that the output is always 0, or always TOP."""
    rng = np.random.default_rng(seed)
    layers, limit = [], np.array([255] * 3 + [127] * 2)
    for index, neurons in enumerate((7, 6, 3)):
        weight = rng.integers(-127, 128, (neurons, len(limit)))
        bias = rng.integers(-5000, 5000, neurons)
        for (_, neuron), value in ((k, v) for k, v in still.items() if k[0] == index):
            weight[neuron] //= 50
            bias[neuron] = value
        scale = None if index == 2 else Requantisation(rng.integers(60000, 1 << 17, neurons), 24, 7)
        layers.append(Layer(weight, bias, limit, 8, scale))
        limit = np.full(neurons, TOP)
    return layers


def features(seed: int, count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.integers(-255, 256, (count, 3)), rng.integers(-127, 128, (count, 2))])


def result(layers, x: np.ndarray) -> np.ndarray:
    for layer in layers:
        x = layer(x)
    return x


def test_integers_stay_the_same_where_the_neurons_are_constant():
    still = {(0, 2): -50_000, (0, 6): 80_000, (1, 0): -60_000, (1, 5): 60_000}
    layers = network(1, still=still)
    found = without_constant(layers, features(1))
    assert [layer.weight.shape for layer in found] == [(5, 5), (4, 5), (3, 4)]
    assert [len(layer.input_limit) for layer in found] == [5, 5, 4]
    x = features(2, 5000)  # the biases make the neurons constant for any features
    np.testing.assert_array_equal(result(found, x), result(layers, x))
    for layer in found:
        replace(layer, loadable=True)  # raises where a bias is too long for loadable hardware


def test_neurons_that_vary_stay():
    layers = network(2, still={})
    found = without_constant(layers, features(1))
    for new, old in zip(found, layers, strict=True):
        np.testing.assert_array_equal(new.weight, old.weight)
        np.testing.assert_array_equal(new.bias, old.bias)


def test_a_layer_keeps_the_fewest_neurons_that_a_scene_may_ask_for():
    layers = network(3, still={(0, k): -60_000 for k in range(7)})
    found = without_constant(layers, features(1))
    assert len(found[0].weight) == FEWEST_NEURONS
    np.testing.assert_array_equal(result(found, features(2)), result(layers, features(2)))


def test_a_neuron_stays_where_the_next_bias_would_become_too_long():
    layers = network(4, still={(1, 3): 90_000})
    weight, bias = layers[2].weight.copy(), layers[2].bias.copy()
    weight[1, 3] = 127
    bias[1] = 127 * 5 * TOP - 100  # what 5 neurons may have, all but 100
    layers[2] = replace(layers[2], weight=weight, bias=bias)
    assert len(without_constant(layers, features(1))[1].weight) == 6
    bias[1] = -bias[1]
    layers[2] = replace(layers[2], bias=bias)
    assert len(without_constant(layers, features(1))[1].weight) == 5


def test_added_neurons_change_nothing():
    layers = network(5, still={})
    found = with_hidden(layers, (9, 6))
    assert [layer.weight.shape for layer in found] == [(9, 5), (6, 9), (3, 6)]
    np.testing.assert_array_equal(result(found, features(1)), result(layers, features(1)))
    for wrong in ((6, 9), (9, 5), (9,)):
        with pytest.raises(ValueError, match=r"hidden neurons \[7, 6\]: expected at most"):
            with_hidden(layers, wrong)
