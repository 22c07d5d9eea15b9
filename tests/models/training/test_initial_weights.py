import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import scales
from fastac.models.training.initial_weights import set_active
from fastac.models.training.pruning.hidden_neurons import outputs


@pytest.fixture
def pixels() -> np.ndarray:
    """Integer features of channels that are much alike, as of a skin at rest, and of x, y: (6000, 6)."""
    rng = np.random.default_rng(1)
    channels = np.array([0.4, 0.3, 0.5, 0.2]) + 0.01 * rng.standard_normal((6000, 4))
    return np.rint(np.hstack([channels, rng.uniform(-1, 1, (6000, 2))]) / scales(4)).astype(np.int16)


def uniform(seed: int, hidden: tuple[int, ...] = (16, 16, 16)) -> PixelNetwork:
    torch.manual_seed(seed)
    return PixelNetwork(6, hidden)


def active_shares(network: PixelNetwork, x: np.ndarray) -> list[np.ndarray]:
    """Share of the pixels at which each neuron is active, by hidden layer."""
    return [(layer > 0).mean(axis=0) for layer in outputs(network, x)]


@pytest.mark.parametrize("seed", range(5))
def test_every_neuron_is_active_at_some_pixels_and_not_at_all(pixels, seed):
    network = uniform(seed)
    assert (active_shares(network, pixels)[2] == 0).sum() >= 3  # what it is for
    set_active(network, pixels, seed)
    for shares in active_shares(network, pixels):
        assert (shares > 0).all()
        assert (shares < 1).all()


def test_weights_are_orthogonal(pixels):
    network = uniform(1, (16, 8))
    set_active(network, pixels, 1)
    wide, narrow = (layer.weight.detach() for layer in network.linear_layers[:-1])
    torch.testing.assert_close(wide.T @ wide, torch.eye(6))
    torch.testing.assert_close(narrow @ narrow.T, torch.eye(8))


def test_the_last_layer_stays(pixels):
    network = uniform(1)
    last = network.linear_layers[-1].weight.clone()
    set_active(network, pixels, 1)
    assert torch.equal(network.linear_layers[-1].weight, last)
    assert network.linear_layers[-1].bias.tolist() == [0, 0, 1]


def test_the_seed_decides_everything_and_torch_s_own_goes_on(pixels):
    first, again, other = uniform(1), uniform(1), uniform(1)
    torch.manual_seed(5)
    set_active(first, pixels, 2)
    drawn = torch.rand(3)
    torch.manual_seed(5)
    assert torch.equal(drawn, torch.rand(3))
    set_active(again, pixels, 2)
    set_active(other, pixels, 3)
    found = [torch.nn.utils.parameters_to_vector(network.parameters()) for network in (first, again, other)]
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])
