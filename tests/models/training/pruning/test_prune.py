import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.labelled_pixels import labelled_splits
from fastac.models.training.normals import train
from fastac.models.training.pruning import prune
from fastac.models.training.pruning.hidden_neurons import widths


@pytest.fixture(scope="module")
def trained(tiny_data, make_scene):
    """A network, its settings and pixels."""
    settings = make_scene(training={"normals_epochs": 10, "normals_batch_px": 1024}).training
    network, _ = train(tiny_data, settings, (8, 8, 8))
    return network, settings, labelled_splits(tiny_data, settings)


@pytest.mark.parametrize("growth", [0.0, 0.2])
def test_as_few_neurons_as_the_error_allows(trained, growth):
    network, settings, pixels = trained
    before = [weight.clone() for weight in network.state_dict().values()]
    found = prune.prune_neurons(network, pixels, settings, growth=growth, slope_limit=4)
    first, error = (prune.gradient_error(k, *pixels["validation"], 4) for k in (network, found))
    assert error <= (1 + growth) * first
    assert min(widths(found)) >= 4
    if growth:
        assert sum(widths(found)) < 20
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
        further_errors=[lambda candidate: 100 - sum(widths(candidate))],
    )
    assert kept is network


def test_the_smallest_network_stays(trained):
    _, settings, pixels = trained
    smallest = PixelNetwork(6, (4, 4, 4))
    found = prune.prune_neurons(smallest, pixels, settings, growth=0.5, slope_limit=4)
    assert found is smallest


def test_the_neurons_of_least_effect_go_until_a_width_is_reached(trained, monkeypatch):
    network, settings, pixels = trained
    before = [weight.clone() for weight in network.state_dict().values()]
    on_the_way, trained_on = [], prune.Pruning.trained_on

    def watched(pruning, candidate, share):
        on_the_way.append((widths(candidate), share))
        return trained_on(pruning, candidate, share)

    monkeypatch.setattr(prune.Pruning, "trained_on", watched)
    found = prune.prune_to_width(network, pixels, settings, width=(8, 6, 5), slope_limit=4)
    assert widths(found) == (8, 6, 5)
    assert [sum(width) for width, _ in on_the_way] == [23, 22, 21, 20, 19] + [19] * prune.LAST_ROUNDS
    rounds = [prune.LAST_SHARE] * prune.LAST_ROUNDS
    assert [share for _, share in on_the_way] == [prune.WIDTH_SHARE] * 5 + rounds
    assert all(width[0] == 8 and width[1] >= 6 and width[2] >= 5 for width, _ in on_the_way)
    assert all(torch.equal(a, b) for a, b in zip(before, network.state_dict().values(), strict=True))
    again = prune.prune_to_width(network, pixels, settings, width=(8, 6, 5), slope_limit=4)
    assert all(
        torch.equal(a, b)
        for a, b in zip(found.state_dict().values(), again.state_dict().values(), strict=True)
    )
    cut = prune.Pruning(pixels, settings, 4, progress=False)
    while widths(network) != (8, 6, 5):
        network = cut.ranked(network, (8, 6, 5))[0]
    assert cut.error(found) < cut.error(network)  # training on makes up for what was removed


def test_a_network_of_the_width_asked_stays(trained):
    network, settings, pixels = trained
    assert prune.prune_to_width(network, pixels, settings, width=(8, 8, 8), slope_limit=4) is network
