import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork, predict
from fastac.models.training.initial_weights import set_orthogonal
from fastac.models.training.pruning.hidden_neurons import outputs

SEED = 3


@pytest.fixture
def x() -> np.ndarray:
    """Features of which a twentieth is in contact: far from unit spread, as real ones are."""
    rng = np.random.default_rng(0)
    colours = rng.normal(0, 2, (4000, 4))
    colours[::20] += rng.normal(0, 40, (200, 4))
    places = rng.integers(-64, 64, (4000, 2))
    return np.hstack([colours, places]).round().astype(np.int16)


def weighed(x: np.ndarray, seed: int = SEED) -> PixelNetwork:
    network = PixelNetwork(6)
    set_orthogonal(network, x, seed)
    return network


def test_every_neuron_is_active_for_some_of_the_pixels(x):
    for hidden in outputs(weighed(x), x):
        active = (hidden > 0).mean(axis=0)
        assert active.min() > 0.02
        assert active.max() < 0.98


def test_rows_are_orthogonal_where_all_inputs_spread_alike(x):
    """A matrix of orthogonal rows and columns, to the scale of its inputs."""
    weight = weighed(x).linear_layers[1].weight.detach()
    product = weight @ weight.T
    scale = product.diagonal().mean()
    torch.testing.assert_close(product, scale * torch.eye(16), atol=1e-5 * scale.item(), rtol=0)


def test_units_of_the_features_do_not_matter(x):
    """Contacts that are ten times as bright give the same hidden activations but for their unit."""
    few = np.column_stack([10 * x[:, :4], x[:, 4:]])
    first, brighter = outputs(weighed(x), x)[0], outputs(weighed(few), few)[0]
    np.testing.assert_allclose(brighter, first, atol=1e-4)


def test_normals_begin_near_that_of_a_surface_that_faces_the_camera(x):
    found = predict(weighed(x), x)
    assert (found[:, 2] > 0).mean() > 0.95
    assert np.abs(found[:, :2]).mean() < 0.5


def test_the_seed_decides_everything(x):
    torch.manual_seed(99)  # what others drew before must not matter
    one = weighed(x)
    torch.manual_seed(7)
    states = [weighed(x, seed).state_dict() for seed in (SEED, SEED + 1)]
    assert all(torch.equal(value, states[0][key]) for key, value in one.state_dict().items())
    assert not torch.equal(states[0]["layers.0.weight"], states[1]["layers.0.weight"])


@pytest.mark.parametrize("pixels", [1, 30])
def test_few_pixels_or_equal_ones_give_finite_weights(pixels):
    network = weighed(np.zeros((pixels, 6), np.int16))
    assert all(value.isfinite().all() for value in network.state_dict().values())
