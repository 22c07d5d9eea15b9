import numpy as np
import pytest
import torch

from fastac.models.floating.hyperforce import collapse, coordinates
from fastac.models.floating.hyperforce_3d import INPUTS, HyperForce3D

N, FRAMES = 9, 4


def model(kernel_size=3, inputs="xyz", dynamic=True, axes=3):
    torch.manual_seed(1)
    rest = np.random.default_rng(1).random((N, N))
    made = HyperForce3D(
        coordinates(rest), kernel_size=kernel_size, hidden=5, inputs=inputs, dynamic=dynamic, axes=axes
    )
    made.unit.fill_(0.5)
    return made


def displacement(inputs="xyz"):
    return np.random.default_rng(2).normal(size=(FRAMES, len(INPUTS[inputs]), N, N)).astype(np.float32)


every = pytest.mark.parametrize(
    ("kernel_size", "inputs", "dynamic"),
    [(k, inputs, dynamic) for k in (1, 3, 5, 7) for inputs in INPUTS for dynamic in (True, False)],
)


@every
def test_the_resultant_is_the_sum_of_the_force_map(kernel_size, inputs, dynamic):
    """Collapsed weights against patches: the same force, whatever the window, inputs and kernel."""
    made, d = model(kernel_size, inputs, dynamic), displacement(inputs)
    patches = made.force_map_n(d)
    assert patches.shape == (FRAMES, 3, N, N)
    force = made(torch.from_numpy(d)).detach().numpy()
    np.testing.assert_allclose(force, patches.sum(axis=(-2, -1)), atol=1e-4)


@every
def test_the_collapsed_weights_are_those_of_the_kernels(kernel_size, inputs, dynamic):
    made = model(kernel_size, inputs, dynamic)
    kernels = made.kernels().detach().numpy()
    assert kernels.shape == (3, len(INPUTS[inputs]), N, N, kernel_size, kernel_size)
    for k, axis in enumerate(kernels):
        np.testing.assert_allclose(made.collapsed()[k].detach(), collapse(axis), atol=1e-5)


@every
def test_the_force_is_linear_in_the_features(kernel_size, inputs, dynamic):
    made, d = model(kernel_size, inputs, dynamic), torch.from_numpy(displacement(inputs))
    x = made.features(d).astype(np.float64)
    weights = np.random.default_rng(3).normal(size=(x.shape[1], 3))
    made.set_last_layer(weights)
    np.testing.assert_allclose(made(d).detach(), x @ weights, atol=1e-4 * np.abs(x @ weights).max())


def test_a_fixed_kernel_is_one_for_all_pixels_and_a_dynamic_one_is_not():
    fixed, dynamic = (model(dynamic=kind).kernels().detach().numpy() for kind in (False, True))
    np.testing.assert_array_equal(fixed, np.broadcast_to(fixed[:, :, :1, :1], fixed.shape))
    assert np.ptp(dynamic, axis=(2, 3)).min() > 0
    assert sum(p.numel() for p in model(dynamic=False).parameters()) == 3 * 3 * 3**2


def test_each_input_has_its_own_place():
    """Along an axis whose kernel is zero, a component moves no force."""
    made, d = model(kernel_size=1, dynamic=False), displacement()
    weight = torch.zeros(3, 3)
    weight[0, 0], weight[1, 1], weight[2, 2] = 1.0, 2.0, 3.0
    with torch.no_grad():
        made.layers[-1].weight.copy_(weight.reshape(9, 1) / made.unit)
    sums = d.sum(axis=(-2, -1))
    np.testing.assert_allclose(made(torch.from_numpy(d)).detach(), sums * [1, 2, 3], atol=1e-4)


def test_unknown_inputs():
    with pytest.raises(ValueError, match="inputs = 'zx': expected one of xy, z, xyz"):
        model(inputs="zx")
