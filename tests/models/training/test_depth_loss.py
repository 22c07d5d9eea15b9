"""Training with the depth's error: the depth is the solver's, and becomes better at no other frame's cost."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.flow.training import TrainingError, require
from fastac.models.floating import network as floating
from fastac.models.floating.network import PixelNetwork
from fastac.models.training import depth_loss
from fastac.models.training.depth_loss import Surface, WholeFrames
from fastac.models.training.network_depth import depth_mae_mm, found_depth_mm
from fastac.models.training.normals import train
from fastac.sensor.geometry import rest_depth_mm


def test_slopes_are_those_of_the_float_network():
    """Normals that face away, lie in the image plane or are no normals at all included."""
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(500, 3)).astype(np.float32)
    normal[:4] = [[1, -1, 0], [0, 0, 0], [1, 0, -1], [1e-3, 0, 1e-7]]
    expected = floating.slopes_of(normal.astype(np.float64), 4)
    found = depth_loss.slopes_of(torch.from_numpy(normal), 4).numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_no_gradient_is_infinite():
    normal = torch.tensor([[1.0, -1, 0], [0, 0, 0], [1, 0, -1], [1e-9, 1, 1e-9]], requires_grad=True)
    depth_loss.slopes_of(normal, 4).square().sum().backward()
    assert torch.isfinite(normal.grad).all()


@pytest.mark.parametrize("divergence", ["central", "backward"])
@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_depth_is_the_solver_s(tiny_data, make_scene, mode, divergence):
    scene = make_scene(poisson={"mode": mode, "divergence": divergence})
    torch.manual_seed(1)
    network, rest = PixelNetwork(tiny_data.frames.shape[-1] + 2, (5, 4)), rest_depth_mm(scene.sensor)
    frames, index = WholeFrames(tiny_data, tiny_data, scene, rest), np.array([0, 3])
    with torch.inference_mode():
        features = frames.features(np.concatenate([tiny_data.frames[index], tiny_data.background[None]]))
        slopes = depth_loss.slopes_of(network(features), scene.numbers.slope_limit)
        found = Surface(scene, rest)(slopes[:-1], slopes[-1]) - frames.depth_px(index)
    expected = found_depth_mm(network, tiny_data.frames[index], tiny_data, scene, rest_depth_mm=rest)
    expected -= tiny_data.depth_mm[index][:, 1:-1, 1:-1]
    scale = np.abs(tiny_data.depth_mm).max()
    np.testing.assert_allclose(found.numpy() * scene.sensor.pitch_mm, expected, rtol=0, atol=1e-5 * scale)


@pytest.fixture(scope="module")
def trained(tiny_data, tiny_scene) -> PixelNetwork:
    return train(tiny_data, tiny_scene.training, (8, 8, 8))[0]


@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_depth_gets_better_on_frames_that_were_held_out(tiny_data, make_scene, trained, mode):
    training = {"depth_weight": 5.0, "depth_epochs": 20}
    scene = make_scene(poisson={"mode": mode}, training=training)
    rest, test = rest_depth_mm(scene.sensor), tiny_data.indices("test")
    network = copy.deepcopy(trained)
    history = depth_loss.train(network, WholeFrames(tiny_data, tiny_data, scene, rest))
    assert len(history) == 20
    before, after = (
        depth_mae_mm(model, tiny_data, scene, test, rest_depth_mm=rest) for model in (trained, network)
    )
    assert after < 0.8 * before


def test_the_same_seed_gives_the_same_network(tiny_data, make_scene, trained):
    scene = make_scene(training={"depth_weight": 1.0, "depth_epochs": 2, "normals_share": 0.5})
    rest, found = rest_depth_mm(scene.sensor), []
    for _ in range(2):
        network = copy.deepcopy(trained)
        depth_loss.train(network, WholeFrames(tiny_data, tiny_data, scene, rest))
        found.append(torch.cat([values.flatten() for values in network.parameters()]))
    assert torch.equal(*found)
    assert not torch.equal(found[0], torch.cat([values.flatten() for values in trained.parameters()]))


def test_a_training_that_loses_leaves_the_network_as_it_was(tiny_data, make_scene, trained):
    training = {"depth_weight": 1.0, "depth_epochs": 1, "normals_learning_rate": 100.0}
    scene = make_scene(training=training)
    network = copy.deepcopy(trained)
    depth_loss.train(network, WholeFrames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor)))
    for found, expected in zip(network.parameters(), trained.parameters(), strict=True):
        assert torch.equal(found, expected)


def test_normals_that_are_not_learned_from_do_not_count(tiny_data, make_scene, trained):
    scene = make_scene(training={"depth_weight": 1e-9, "depth_epochs": 1})
    rest, valid = rest_depth_mm(scene.sensor), np.zeros(tiny_data.frames.shape[:3], bool)
    valid[:, 4:12, 4:12] = True
    wrong = tiny_data.normals.copy()
    wrong[~valid] = [1, 0, 0]
    found = []
    for normals in (tiny_data.normals, wrong):
        skin, network = replace(tiny_data, normals=normals, valid=valid), copy.deepcopy(trained)
        depth_loss.train(network, WholeFrames(tiny_data, skin, scene, rest))
        found.append(torch.cat([values.flatten() for values in network.parameters()]))
    assert torch.equal(*found)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth_mm": None}, "frames.h5: depth_mm: missing, and training.depth_weight needs"),
        ({"valid": "some"}, "frames.h5: valid: not every pixel is, and training.depth_weight needs"),
    ],
)
def test_unknown_depth_is_refused(tiny_data, make_scene, tmp_path, changes, message):
    if "valid" in changes:
        changes = {"valid": np.ones(tiny_data.frames.shape[:3], bool)}
        changes["valid"][3, 5, 7] = False
    scene = make_scene(training={"depth_weight": 1.0})
    require(tiny_data, scene, tmp_path / "frames.h5")
    with pytest.raises(TrainingError, match=message):
        require(replace(tiny_data, **changes), scene, tmp_path / "frames.h5")
