"""The network with a pixel in each column finds what the network itself finds, and torch's derivatives."""

import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.whole_frames import network_of_columns
from fastac.models.training.whole_frames.network_of_columns import NetworkOfColumns


@pytest.fixture
def network() -> PixelNetwork:
    torch.manual_seed(1)
    return PixelNetwork(6, (5, 4))


@pytest.fixture
def x() -> torch.Tensor:
    """Scaled features of 50 pixels, (inputs, pixels)."""
    return torch.randn(6, 50, generator=torch.Generator().manual_seed(2))


@pytest.mark.parametrize("at_a_time", [7, 25, 8192])
def test_normals_are_the_networks(network, x, at_a_time, monkeypatch):
    monkeypatch.setattr(network_of_columns, "PIXELS_AT_A_TIME", at_a_time)
    torch.testing.assert_close(NetworkOfColumns(network)(x), network(x.T).detach().T)


def test_stages_begin_with_the_features_and_end_with_the_normals(network, x):
    given = x.clone()
    features, *hidden, normals = NetworkOfColumns(network).stages(x)
    assert features is x
    assert torch.equal(x, given)
    assert [len(stage) for stage in hidden] == [5, 4]
    assert all(stage.min() == 0 for stage in hidden)
    torch.testing.assert_close(normals, network(x.T).detach().T)
    assert normals.min() < 0


def test_derivatives_are_torchs(network, x):
    """Of two sums over the normals, weighted by chance."""
    weights = torch.randn(2, 3, 50, generator=torch.Generator().manual_seed(3))
    expected = []
    for weight in weights:
        value = (network(x.T).T * weight).sum()
        gradients = torch.autograd.grad(value, list(network.parameters()))
        expected.append(torch.cat([values.flatten() for values in gradients]))
    columns = NetworkOfColumns(network)
    found = columns.derivatives(columns.stages(x), weights)
    torch.testing.assert_close(found, torch.stack(expected), rtol=1e-4, atol=1e-4)


def test_later_changes_of_the_network_are_not_followed(network, x):
    columns = NetworkOfColumns(network)
    before = columns(x)
    with torch.no_grad():
        network.linear_layers[0].weight.mul_(2)
    assert torch.equal(columns(x), before)
