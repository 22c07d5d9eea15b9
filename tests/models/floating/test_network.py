import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.integer.features import scales
from fastac.models.integer.network import GradientRatio
from fastac.models.training.normals import normal_loss


def test_a_network_of_arrays_is_the_one_they_are_of():
    torch.manual_seed(1)
    network, x = PixelNetwork(6, (5, 4)), torch.rand(20, 6)
    assert torch.equal(PixelNetwork.from_arrays(network.arrays)(x), network(x))


def test_arrays_are_copies():
    network = PixelNetwork(5, hidden=(4,))
    arrays = network.arrays
    assert {k: v.shape for k, v in arrays.items()} == {
        "network.0.weight": (4, 5),
        "network.0.bias": (4,),
        "network.1.weight": (3, 4),
        "network.1.bias": (3,),
    }
    arrays["network.0.bias"][:] = 9
    assert not (network.linear_layers[0].bias == 9).any()


def test_slopes_by_hand():
    normals = np.array([[0.0, 0, 1], [3, -4, 2], [-1, 2, -5], [0, -2, 0], [0, 0, -1], [0, 0, 0], [9, 1, 1]])
    expected = [[0, 0], [-1.5, 2], [4, -4], [0, 4], [0, 0], [0, 0], [-4, -1]]
    np.testing.assert_array_equal(slopes_of(normals, 4.0), expected)


@pytest.mark.parametrize("n_z", [0.0, -0.0, -1.0, 5e-324, 1e-300])
def test_slopes_stay_finite_where_the_surface_is_steep(n_z):
    """Warnings are errors here: no division may complain."""
    found = slopes_of(np.array([[1.0, -1.0, n_z], [0.0, 1e-320, n_z], [1e300, 0.0, n_z]]), 8.0)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[0], [-8, 8])
    np.testing.assert_array_equal(found[2], [-8, 0])


def test_slopes_agree_with_the_integers_everywhere():
    rng = np.random.default_rng(1)
    normals = rng.integers(-300, 300, (2000, 3))
    normals[:100, 2] = 0
    ratio = GradientRatio(10, 17, 14)
    words, _ = ratio(normals)
    found = slopes_of(normals.astype(float), ratio.limit / 2**14)
    assert np.abs(found - words / 2**14).max() <= 2.0**-15


def test_loss_is_the_paper_s():
    """Mean over pixels of the sum over x, y, z of |unit prediction − truth|."""
    rng = np.random.default_rng(2)
    predicted = rng.normal(size=(50, 3))
    truth = rng.normal(size=(50, 3))
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(predicted, truth, strict=True):
        length = sum(x * x for x in a) ** 0.5
        total += sum(abs(x / length - y) for x, y in zip(a, b, strict=True))
    loss = normal_loss(torch.from_numpy(predicted), torch.from_numpy(truth))
    assert loss.item() == pytest.approx(total / 50)


def test_loss_by_hand():
    up, along = torch.tensor([[0.0, 0, 1]]), torch.tensor([[1.0, 0, 0]])
    assert normal_loss(7 * up, along).item() == 2
    assert normal_loss(7 * up, up).item() == 0
    assert normal_loss(torch.zeros(1, 3), up).item() == 1  # no direction, and no NaN


def test_network_has_the_paper_s_layers_and_starts_flat():
    network = PixelNetwork(6)
    shapes = [tuple(layer.weight.shape) for layer in network.linear_layers]
    assert shapes == [(16, 6), (16, 16), (16, 16), (3, 16)]
    np.testing.assert_array_equal(network.linear_layers[-1].bias.detach(), [0, 0, 1])


def test_predict_equals_the_layers_written_out():
    torch.manual_seed(3)
    network = PixelNetwork(5, hidden=(4, 7))
    features = np.random.default_rng(3).integers(-255, 256, (2, 3, 4, 5), dtype=np.int16)
    found = predict(network, features)
    assert found.shape == (2, 3, 4, 3)
    weights = [
        (layer.weight.detach().double(), layer.bias.detach().double()) for layer in network.linear_layers
    ]
    for index in np.ndindex(2, 3, 4):
        x = features[index] * scales(3)
        for k, (weight, bias) in enumerate(weights):
            x = weight.numpy() @ x + bias.numpy()
            if k < len(weights) - 1:
                x = np.where(x > 0, x, 0)
        np.testing.assert_allclose(found[index], x, rtol=1e-4, atol=1e-5)
