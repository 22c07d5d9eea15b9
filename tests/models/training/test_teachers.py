import numpy as np
import pytest
import torch

from fastac.models.training.normals import normal_loss
from fastac.models.training.teachers import Ensemble


@pytest.fixture
def ensemble() -> Ensemble:
    torch.manual_seed(1)
    return Ensemble(5, teachers=3, width=7)


def one_teacher(ensemble: Ensemble, k: int, x: np.ndarray) -> np.ndarray:
    """Unit normals of the k-th teacher, computed layer by layer."""
    layers = list(zip(ensemble.weights, ensemble.biases, strict=True))
    for index, (weight, bias) in enumerate(layers):
        x = x @ weight[k].detach().double().numpy() + bias[k].detach().double().numpy()
        if index < len(layers) - 1:
            x = np.maximum(x, 0)
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def test_each_teacher_is_a_network_of_its_own(ensemble):
    x = torch.randn(20, 5)
    found = ensemble.train()(x).detach().numpy()
    assert found.shape == (3, 20, 3)
    for k in range(3):
        np.testing.assert_allclose(found[k], one_teacher(ensemble, k, x.double().numpy()), atol=1e-5)
    assert np.abs(found[0] - found[1]).max() > 0.01


def test_each_teacher_may_have_inputs_of_its_own(ensemble):
    x = torch.randn(3, 20, 5)
    found = ensemble.train()(x).detach().numpy()
    for k in range(3):
        np.testing.assert_allclose(found[k], one_teacher(ensemble, k, x[k].double().numpy()), atol=1e-5)


def test_together_they_give_the_mean_direction(ensemble):
    x = torch.randn(20, 5)
    mean = np.mean([one_teacher(ensemble, k, x.double().numpy()) for k in range(3)], axis=0)
    expected = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    np.testing.assert_allclose(ensemble.eval()(x).detach().numpy(), expected, atol=1e-5)


def test_teachers_learn_independently(ensemble):
    """The gradient of one teacher's weights does not depend on the others."""
    x, y = torch.randn(20, 5), torch.tensor([[0.6, 0.0, 0.8]]).expand(20, 3)
    normal_loss(ensemble.train()(x), y).backward()
    before = ensemble.weights[1].grad[0].clone()
    ensemble.zero_grad()
    with torch.no_grad():
        for parameter in ensemble.parameters():
            parameter[1:] *= 3
    normal_loss(ensemble(x), y).backward()
    torch.testing.assert_close(ensemble.weights[1].grad[0], before)
    assert before.abs().max() > 0


def test_starts_facing_the_camera(ensemble):
    np.testing.assert_array_equal(ensemble.biases[-1].detach().reshape(3, 3), np.tile([0, 0, 1], (3, 1)))
