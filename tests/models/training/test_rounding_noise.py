import copy

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.normals import Fit
from fastac.models.training.rounding_noise import RoundingNoise, with_rounding_noise

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


def rounded(network: PixelNetwork, x: torch.Tensor) -> torch.Tensor:
    """The network with hidden activations that are rounded to BITS."""
    *hidden, last = network.linear_layers
    for layer in hidden:
        x = torch.relu(layer(x))
        unit = x.amax(dim=0) / ((1 << BITS) - 1)
        x = torch.round(x / unit.clamp_min(1e-9)) * unit
    return last(x)


def test_a_network_that_felt_the_noise_loses_less_by_rounding():
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
        fit = Fit(epochs=80, batch=400, rate=1e-2, seed=1, label="test", huber_delta=0.1)
        fit(with_rounding_noise(network, bits), x, y)
        with torch.no_grad():
            found = torch.nn.functional.normalize(rounded(network, torch.from_numpy(x)), dim=1)
        errors[bits] = float((found - torch.from_numpy(y)).abs().mean())
    assert errors[BITS] < 0.8 * errors[None]
