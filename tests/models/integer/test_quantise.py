import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from fastac.models.integer import quantise
from fastac.models.integer.features import scales


@pytest.mark.parametrize(
    "largest", [1.0, 1 - 2**-40, 0.75, 1e-3, 2**-20, 1.99999999, 3e-9, 65535.7, 131071.0]
)
def test_requantisation_uses_all_17_bits(largest):
    scale = largest * np.array([1.0, 0.3, 1e-3, 1e-9])
    found = quantise.requantisation(scale, 7)
    assert 1 << 16 <= found.multiplier[0] < 1 << 17
    assert found.multiplier.min() >= 1
    assert found.bits == 7
    ratio = found.multiplier * 2.0**-found.shift / scale
    assert abs(ratio[0] - 1) <= 2.0**-17
    assert np.abs(found.multiplier[:3] - scale[:3] * 2.0**found.shift).max() <= 0.5


def test_requantisation_refuses_scales_without_a_shift():
    with pytest.raises(ValueError, match="shift -1: expected 0 to 47"):
        quantise.requantisation(np.array([2.0**17]), 7)
    with pytest.raises(ValueError, match="expected 0 to 47"):
        quantise.requantisation(np.array([2.0**-40]), 7)


def network(seed: int, sizes=(6, 16, 16, 16, 3)):
    rng = np.random.default_rng(seed)
    weights = [rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes)]
    biases = [rng.normal(size=b) * 0.3 for b in sizes[1:]]
    biases[-1][2] += 3  # normals that face the camera, as trained ones do
    return weights, biases


def features(seed: int, count: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.integers(-120, 121, (count, 4)), rng.integers(-127, 128, (count, 2))])


def by_float(weights, biases, x) -> np.ndarray:
    x = x * scales(4)
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        x = np.maximum(x @ weight.T + bias, 0)
    return x @ weights[-1].T + biases[-1]


def by_integers(layers, x) -> np.ndarray:
    for layer in layers:
        x = layer(x)
    return x


def degrees(a: np.ndarray, b: np.ndarray) -> float:
    """Mean angle between directions."""
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    return float(np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1))).mean())


def layers_of(weights, biases, **changes):
    words = {"weight_bits": 8, "activation_bits": 7, "last_weight_bits": 12, **changes}
    return quantise.quantise_layers(weights, biases, scales(4), features(1), **words)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_layers_point_where_the_float_network_does(seed):
    weights, biases = network(seed)
    x = features(100 + seed)
    truth = by_float(weights, biases, x)
    errors = [
        degrees(by_integers(layers_of(weights, biases, **bits), x), truth)
        for bits in ({}, {"activation_bits": 5}, {"weight_bits": 4}, {"last_weight_bits": 4})
    ]
    assert errors[0] < 0.6
    assert min(errors[1:]) > 1.3 * errors[0]  # every word length counts


@pytest.mark.parametrize("bias", [1e3, -1e3])
@pytest.mark.parametrize("layer", [0, 2, 3])
def test_a_bias_beyond_its_weights_is_loadable_too(layer, bias):
    """So large a bias takes the scale from the weights, whose neuron is always or never active."""
    weights, biases = network(5)
    weights[layer][1] *= 1e-3
    biases[layer][1] = bias
    layers = layers_of(weights, biases)
    chosen = dataclasses.replace(layers[layer], loadable=True)
    assert abs(chosen.bias[1]) == chosen.bias_limit
    assert not chosen.weight[1].any()


def test_layers_use_their_words():
    weights, biases = network(4)
    layers = layers_of(weights, biases)
    assert [layer.weight_bits for layer in layers] == [8, 8, 8, 12]
    for layer in layers[:-1]:
        np.testing.assert_array_equal(np.abs(layer.weight).max(axis=1), np.full(16, 127))
        assert layer.requantisation.bits == 7
    assert np.abs(layers[-1].weight).max() == 2047
    assert layers[-1].requantisation is None
    np.testing.assert_array_equal(layers[0].input_limit, [255] * 4 + [127] * 2)
    np.testing.assert_array_equal(layers[1].input_limit, np.full(16, 127))


def test_activations_reach_their_range_and_hardly_exceed_it():
    weights, biases = network(5)
    layers = layers_of(weights, biases)
    x = features(1)
    for layer in layers[:-1]:
        x = layer(x)
        alive = x.any(axis=0)
        assert (x.max(axis=0)[alive] >= 120).all()
        assert (x == 127).mean(axis=0).max() < 0.01


def test_floors_become_roundings():
    """Half a unit in the bias: activations are off by nothing on average, where a floor would cost 0.5."""
    weights, biases = network(8)
    x = features(1)
    found = layers_of(weights, biases, percentile=99.99)[0](x)
    exact = np.maximum((x * scales(4)) @ weights[0].T + biases[0], 0)
    units = exact / (np.percentile(exact, 99.99, axis=0) / 127)
    inside = (units > 1) & (found < 127)
    assert inside.sum() > 10_000
    error = (found - units)[inside]
    assert abs(error.mean()) < 0.1
    assert error.std() < 0.6


def test_dead_neurons_do_no_harm():
    weights, biases = network(6)
    weights[0][3] = 0  # always its bias
    weights[1][5], biases[1][5] = 0, -1  # never fires
    layers = layers_of(weights, biases)
    x = features(106)
    assert degrees(by_integers(layers, x), by_float(weights, biases, x)) < 0.6
    assert not layers[0].weight[3].any()


WORDS = {"weight_bits": 8, "activation_bits": 10, "last_weight_bits": 12}


class TestCompensatedLayers:
    """Roundings that make up for each other on the calibration pixels."""

    @staticmethod
    def correlated(seed: int) -> np.ndarray:
        """Features whose channels change nearly alike, as a camera's do."""
        rng = np.random.default_rng(seed)
        together = rng.normal(size=(4000, 1)) * 40 + rng.normal(size=(4000, 4)) * 4
        return np.column_stack([np.rint(together).astype(int), rng.integers(-127, 128, (4000, 2))])

    @pytest.mark.parametrize("weight_bits", [5, 8])
    def test_they_err_less_than_the_nearest_integers(self, weight_bits):
        words = WORDS | {"weight_bits": weight_bits}
        nearest, compensated = [], []
        for seed in (1, 2, 3):
            weights, biases = network(seed)
            x = self.correlated(100 + seed)
            truth = by_float(weights, biases, x)
            for errors, way in (
                (nearest, quantise.quantise_layers),
                (compensated, quantise.compensated_layers),
            ):
                layers = way(weights, biases, scales(4), self.correlated(seed), **words)
                errors.append(degrees(by_integers(layers, x), truth))
        assert np.mean(compensated) < 0.7 * np.mean(nearest)

    def test_dead_neurons_do_no_harm_and_all_can_be_loaded(self):
        weights, biases = network(6)
        weights[0][3] = 0  # always its bias
        weights[1][5], biases[1][5] = 0, -1  # never fires
        layers = quantise.compensated_layers(weights, biases, scales(4), features(1), **WORDS)
        x = features(106)
        assert degrees(by_integers(layers, x), by_float(weights, biases, x)) < 0.6
        for layer in layers:
            dataclasses.replace(layer, loadable=True)  # refuses what hardware for any weights could not hold


def test_layers_survive_a_file():
    layers = layers_of(*network(7))
    arrays = quantise.layers_to_arrays(layers)
    assert all(isinstance(array, np.ndarray) for array in arrays.values())
    found = quantise.layers_from_arrays(arrays)
    assert len(found) == len(layers)
    for a, b in zip(layers, found, strict=True):
        for name in ("weight", "bias", "input_limit"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert a.weight_bits == b.weight_bits
        assert (a.requantisation is None) == (b.requantisation is None)
        if a.requantisation is not None:
            np.testing.assert_array_equal(a.requantisation.multiplier, b.requantisation.multiplier)
            assert (a.requantisation.shift, a.requantisation.bits) == (
                b.requantisation.shift,
                b.requantisation.bits,
            )
    assert quantise.layers_from_arrays({}) == ()
