import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork, predict
from fastac.models.training import prune
from fastac.models.training.normals import labelled_splits, train


@pytest.fixture(scope="module")
def trained(tiny_data, make_scene):
    """A network, its settings and pixels."""
    settings = make_scene(training={"normals_epochs": 10, "normals_batch_px": 1024}).training
    network, _ = train(tiny_data, settings, (8, 8, 8))
    return network, settings, labelled_splits(tiny_data, settings)


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


def test_neurons_that_add_nothing_go_at_no_cost(trained):
    network, _, pixels = trained
    x = pixels["train"][0][:3000]
    wider = with_idle_neurons(network)
    np.testing.assert_allclose(predict(wider, x), predict(network, x), atol=1e-5)
    hidden = prune.outputs(wider, x)
    for neuron in (0, 8, 9):
        fewer = prune.without_neuron(wider, 1, neuron, hidden[1])
        assert prune.widths(fewer) == (8, 9, 8)
        np.testing.assert_allclose(predict(fewer, x), predict(network, x), atol=1e-4)
    assert len(list(prune.candidates(wider, x))) == 26


@pytest.mark.parametrize("growth", [0.0, 0.2])
def test_as_few_neurons_as_the_error_allows(trained, growth):
    network, settings, pixels = trained
    before = [weight.clone() for weight in network.state_dict().values()]
    found = prune.prune_neurons(network, pixels, settings, growth=growth, slope_limit=4)
    first, error = (prune.gradient_error(k, *pixels["validation"], 4) for k in (network, found))
    assert error <= (1 + growth) * first
    assert min(prune.widths(found)) >= 4
    if growth:
        assert sum(prune.widths(found)) < 20
    again = prune.prune_neurons(network, pixels, settings, growth=growth, slope_limit=4)
    for one, other in zip(found.state_dict().values(), again.state_dict().values(), strict=True):
        assert torch.equal(one, other)
    assert all(torch.equal(a, b) for a, b in zip(before, network.state_dict().values(), strict=True))


def test_another_error_may_not_grow_either(trained):
    network, settings, pixels = trained
    kept = prune.prune_neurons(
        network,
        pixels,
        settings,
        growth=0.0,
        slope_limit=4,
        further_error=lambda candidate: 100 - sum(prune.widths(candidate)),
    )
    assert kept is network


def test_the_smallest_network_stays(trained):
    _, settings, pixels = trained
    smallest = PixelNetwork(6, (4, 4, 4))
    found = prune.prune_neurons(smallest, pixels, settings, growth=0.5, slope_limit=4)
    assert found is smallest
