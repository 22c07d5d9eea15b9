import copy

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales
from fastac.models.integer.quantise import quantise_layers
from fastac.models.training.normals import Fit
from fastac.models.training.rounding_noise import RoundingNoise, weight_units, with_rounding_noise

BITS = 4


@pytest.fixture
def network() -> PixelNetwork:
    torch.manual_seed(3)
    return PixelNetwork(5, (6, 4))


def test_in_evaluation_it_is_the_network(network):
    x = torch.rand(20, 5)
    assert torch.equal(RoundingNoise(network, BITS).eval()(x), network(x))


def test_without_bits_there_is_no_noise(network):
    assert with_rounding_noise(network, None) is network


@pytest.fixture
def one() -> PixelNetwork:
    """One hidden layer, each neuron handed on by itself."""
    torch.manual_seed(3)
    network = PixelNetwork(5, (3,))
    with torch.no_grad():
        network.linear_layers[-1].weight.copy_(torch.eye(3))
        network.linear_layers[-1].bias.zero_()
    return network


def test_activations_are_off_by_half_a_unit_at_most(one):
    """A neuron's unit is its largest activation over 15."""
    x = torch.rand(4000, 5) * torch.tensor([1.0, 2, 3, 4, 5])
    hidden = torch.relu(one.linear_layers[0](x))
    errors = (RoundingNoise(one, BITS)(x) - hidden).detach()
    unit = hidden.amax(dim=0).detach() / 15
    assert (errors.abs() <= unit / 2 * 1.001).all()
    alive = unit > 0
    assert alive.any()
    spread = (errors.std(dim=0) / unit * np.sqrt(12))[alive]
    assert spread.numpy() == pytest.approx(1, abs=0.05)


def test_copies_of_a_batch_share_their_units(one):
    """The second copy is a hundredth of the first, and its noise as large."""
    x = torch.rand(4000, 5)
    x = torch.stack([x, x / 100])
    errors = (RoundingNoise(one, BITS)(x) - torch.relu(one.linear_layers[0](x))).detach()
    large, small = errors.std(dim=1).numpy()
    assert (large > 0).any()
    assert small == pytest.approx(large, rel=0.05)


def test_weights_are_off_by_half_a_unit_at_most(one):
    """The same in all pixels of a batch; the biases, here so large that all neurons are active, are exact."""
    with torch.no_grad():
        one.linear_layers[0].bias.fill_(100.0)
    x, noisy = torch.eye(5), RoundingNoise(one, weight_bits=BITS)
    errors = torch.stack([noisy(x) - one(x) for _ in range(4000)]).detach()  # (draws, inputs, neurons)
    unit = weight_units(one.linear_layers[0].weight.detach(), noisy.feature_scales, BITS).T
    assert (errors.abs() <= unit / 2 + 1e-4).all()
    spread = errors.std(dim=0) / unit * np.sqrt(12)
    assert spread.numpy() == pytest.approx(1, abs=0.05)


def test_units_of_weights_are_those_of_the_integers(network):
    """Weights in these units, rounded, are the integer weights."""
    rng = np.random.default_rng(0)
    features = rng.integers(-100, 101, (400, 5))
    arrays = [layer.weight.detach().double().numpy() for layer in network.linear_layers]
    layers = quantise_layers(
        arrays,
        [np.zeros(len(weight)) for weight in arrays],
        scales(3),
        features,
        weight_bits=BITS,
        activation_bits=10,
        last_weight_bits=12,
    )
    into, unit = features * scales(3), scales(3)
    for weight, layer in zip(arrays[:-1], layers, strict=False):
        units = weight_units(torch.from_numpy(weight), torch.from_numpy(unit), BITS).numpy()
        np.testing.assert_array_equal(np.rint(weight / units), layer.weight)
        into = np.maximum(into @ weight.T, 0)
        unit = into.max(axis=0)


def test_a_dead_neuron_s_weights_have_a_unit(one):
    units = weight_units(one.linear_layers[0].weight.detach(), torch.tensor([0.0, 1, 1, 1, 1]), BITS)
    assert torch.isfinite(units).all()
    assert torch.isfinite(weight_units(torch.ones(3, 5), torch.zeros(5), BITS)).all()


def nearest(x: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
    return torch.round(x / unit.clamp_min(1e-9)) * unit


def rounded(network: PixelNetwork, x: torch.Tensor, what: str) -> torch.Tensor:
    """The network whose hidden activations or weights are rounded to BITS."""
    *hidden, last = network.linear_layers
    unit = RoundingNoise(network, BITS).feature_scales
    for layer in hidden:
        weight = layer.weight
        if what == "weight_bits":
            weight = nearest(weight, weight_units(weight, unit, BITS))
        x = torch.relu(torch.nn.functional.linear(x, weight, layer.bias))
        unit = x.amax(dim=0)
        if what == "activation_bits":
            x = nearest(x, unit / ((1 << BITS) - 1))
    return last(x)


@pytest.mark.parametrize("what", ["activation_bits", "weight_bits"])
def test_a_network_that_felt_the_noise_loses_less_by_rounding(what):
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (4000, 4)).astype(np.float32)
    slopes = np.stack([np.sin(3 * x[:, 0]), x[:, 1] ** 2], axis=1) / 2
    y = np.concatenate([-slopes, np.ones((len(x), 1))], axis=1)
    y = (y / np.linalg.norm(y, axis=1, keepdims=True)).astype(np.float32)
    torch.manual_seed(1)
    start = PixelNetwork(4, (12, 12))
    errors = {}
    for bits in (None, BITS):
        network = copy.deepcopy(start)
        felt = {"activation_bits": None, "weight_bits": None} | {what: bits}
        fit = Fit(epochs=80, batch=400, rate=1e-2, seed=1, label="test", huber_delta=0.1)
        fit(with_rounding_noise(network, **felt), x, y)
        with torch.no_grad():
            found = torch.nn.functional.normalize(rounded(network, torch.from_numpy(x), what), dim=1)
        errors[bits] = float((found - torch.from_numpy(y)).abs().mean())
    assert errors[BITS] < 0.8 * errors[None]
