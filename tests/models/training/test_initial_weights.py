import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.initial_weights import set_active


@pytest.fixture
def pixels() -> torch.Tensor:
    """Channels that are much alike, as of a skin at rest, and x, y: (6000, 6)."""
    generator = torch.Generator().manual_seed(1)
    channels = torch.tensor([0.4, 0.3, 0.5, 0.2]) + 0.01 * torch.randn(6000, 4, generator=generator)
    return torch.cat([channels, 2 * torch.rand(6000, 2, generator=generator) - 1], dim=1)


def uniform(seed: int, hidden: tuple[int, ...] = (16, 16, 16)) -> PixelNetwork:
    torch.manual_seed(seed)
    return PixelNetwork(6, hidden)


def set_in(network: PixelNetwork, pixels: torch.Tensor, seed: int) -> None:
    """From features that are scaled by a half."""
    set_active(network, 2 * pixels.numpy(), np.full(6, 0.5), seed)


def active_shares(network: PixelNetwork, x: torch.Tensor) -> list[torch.Tensor]:
    """Share of the pixels at which each neuron is active, by hidden layer."""
    found = []
    with torch.no_grad():
        for layer in network.linear_layers[:-1]:
            x = layer(x)
            found.append((x > 0).double().mean(dim=0))
            x = torch.relu(x)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_every_neuron_is_active_at_some_pixels_and_not_at_all(pixels, seed):
    network = uniform(seed)
    assert (active_shares(network, pixels)[2] == 0).sum() >= 3  # what it is for
    set_in(network, pixels, seed)
    for shares in active_shares(network, pixels):
        assert (shares > 0).all()
        assert (shares < 1).all()


def test_weights_are_orthogonal(pixels):
    network = uniform(1, (16, 8))
    set_in(network, pixels, 1)
    wide, narrow = (layer.weight.detach() for layer in network.linear_layers[:-1])
    torch.testing.assert_close(wide.T @ wide, torch.eye(6))
    torch.testing.assert_close(narrow @ narrow.T, torch.eye(8))


def test_the_last_layer_stays(pixels):
    network = uniform(1)
    last = network.linear_layers[-1].weight.clone()
    set_in(network, pixels, 1)
    assert torch.equal(network.linear_layers[-1].weight, last)
    assert network.linear_layers[-1].bias.tolist() == [0, 0, 1]


def test_the_seed_decides_everything_and_torch_s_own_goes_on(pixels):
    first, again, other = uniform(1), uniform(1), uniform(1)
    torch.manual_seed(5)
    set_in(first, pixels, 2)
    drawn = torch.rand(3)
    torch.manual_seed(5)
    assert torch.equal(drawn, torch.rand(3))
    set_in(again, pixels, 2)
    set_in(other, pixels, 3)
    found = [torch.nn.utils.parameters_to_vector(network.parameters()) for network in (first, again, other)]
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])
