import numpy as np
import pytest
import torch

from fastac.models.floating.hyperforce import HyperForce, collapse, coordinates


def model(n: int = 6, *, kernel_size: int = 3, axes: int = 1) -> HyperForce:
    torch.manual_seed(n + kernel_size)
    rest = np.random.default_rng(1).random((n, n))
    return HyperForce(coordinates(rest), kernel_size=kernel_size, hidden=5, axes=axes)


def force_map(kernels: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """f(p) = w(p)·v(p) for every pixel, with zeros outside; (axes, N, N)."""
    axes, n, _, k, _ = kernels.shape
    half = k // 2
    found = np.zeros((axes, n, n))
    for a, i, j, di, dj in np.ndindex(axes, n, n, k, k):
        v, u = i + di - half, j + dj - half
        if 0 <= v < n and 0 <= u < n:
            found[a, i, j] += kernels[a, i, j, di, dj] * displacement[v, u]
    return found


def test_coordinates_are_normalised():
    rest = np.array([[0.0, 1, 0], [2, 4, 2], [0, 1, 0]])
    found = coordinates(rest)
    assert found.shape == (3, 3, 3)
    np.testing.assert_array_equal(found[..., 0], np.tile([-1, 0, 1], (3, 1)))  # u, along a row
    np.testing.assert_array_equal(found[..., 1], np.tile([[-1], [0], [1]], (1, 3)))
    np.testing.assert_array_equal(found[..., 2], rest / 2 - 1)


def test_a_flat_skin_has_no_third_coordinate():
    np.testing.assert_array_equal(coordinates(np.full((4, 4), 3.0))[..., 2], np.zeros((4, 4)))


@pytest.mark.parametrize(("n", "k", "axes"), [(6, 3, 1), (5, 5, 2), (4, 7, 1), (3, 1, 3)])
def test_collapse_equals_the_explicit_sum_over_patches(n, k, axes):
    rng = np.random.default_rng(n)
    kernels = rng.normal(size=(axes, n, n, k, k))
    weights = collapse(kernels)
    assert weights.shape == (axes, n, n)
    for _ in range(5):
        d = rng.normal(size=(n, n))
        total = force_map(kernels, d).sum(axis=(1, 2))
        np.testing.assert_allclose((weights * d).sum(axis=(1, 2)), total, atol=1e-12)
    # Where the weight of a corner comes from: the kernels that see it.
    d = np.zeros((n, n))
    d[0, -1] = 1
    np.testing.assert_allclose(weights[:, 0, -1], force_map(kernels, d).sum(axis=(1, 2)), atol=1e-12)


@pytest.mark.parametrize("axes", [1, 3])
def test_forward_is_the_sum_of_the_force_map(axes):
    network = model(6, kernel_size=5, axes=axes)
    kernels = network.kernels().detach().double().numpy()
    assert kernels.shape == (axes, 6, 6, 5, 5)
    d = np.random.default_rng(2).random((4, 6, 6))
    found = network(torch.from_numpy(d.astype(np.float32))).detach().numpy()
    assert found.shape == (4, axes)
    for force, frame in zip(found, d, strict=True):
        np.testing.assert_allclose(force, force_map(kernels, frame).sum(axis=(1, 2)), rtol=1e-4, atol=1e-5)


def test_each_kernel_is_the_hypernetwork_s_at_its_pixel():
    network = model(6, axes=2)
    with torch.inference_mode():
        kernels = network.kernels()
        for v, u in ((0, 5), (5, 0), (2, 3)):
            place = torch.tensor(coordinates(np.random.default_rng(1).random((6, 6)))[v, u]).float()
            expected = network.layers(place).reshape(2, 3, 3)
            torch.testing.assert_close(kernels[:, v, u], expected)


def test_kernels_depend_on_the_position():
    kernels = model().kernels().detach().numpy()[0]
    assert np.abs(kernels[0, 0] - kernels[5, 5]).max() > 1e-3
    assert np.abs(kernels[0, 5] - kernels[5, 0]).max() > 1e-3


def test_the_unit_scales_every_kernel():
    network = model()
    before = network.kernels().detach()
    network.unit.fill_(2.5)
    torch.testing.assert_close(network.kernels().detach(), 2.5 * before)


def test_gradients_reach_every_weight_of_the_hypernetwork():
    network = model()
    displacement = torch.rand(3, 6, 6)
    network(displacement).abs().sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().max() > 0, name
    assert {name for name, _ in network.named_buffers()} == {"coordinate", "unit"}
