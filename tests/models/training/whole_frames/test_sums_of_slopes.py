"""Training with the error of depth or force: both become better on frames that were held out."""

import copy

import numpy as np
import pytest
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.training.normals import train
from fastac.models.training.whole_frames import force_features, sums_of_slopes
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.network_depth import depth_mae_mm
from fastac.models.training.whole_frames.pixel_grid import WHOLE
from fastac.sensor.geometry import rest_depth_mm


@pytest.fixture(scope="module")
def trained(tiny_data, tiny_scene) -> PixelNetwork:
    return train(tiny_data, tiny_scene.training, (8, 8, 8))[0]


@pytest.fixture
def skins(tiny_data, make_scene):
    """Of the tiny dataset: `skins(depth_weight=1.0)`, keys of `training`."""

    def made(mode: str = "absolute", **training) -> WholeFrames:
        scene = make_scene(poisson={"mode": mode}, training=training)
        return WholeFrames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))

    return made


def parameters(network: PixelNetwork) -> torch.Tensor:
    return torch.cat([values.detach().flatten() for values in network.parameters()])


@pytest.mark.parametrize("mode", ["absolute", "difference"])
def test_depth_gets_better_on_frames_that_were_held_out(skins, tiny_data, trained, mode):
    frames = skins(mode, depth_weight=5.0, depth_epochs=20)
    network, test = copy.deepcopy(trained), tiny_data.indices("test")
    history = sums_of_slopes.train(network, frames)
    assert [entry["epoch"] for entry in history] == list(range(1, 21))
    before, after = (
        depth_mae_mm(model, tiny_data, frames.scene, test, rest_depth_mm=frames.rest_depth_mm)
        for model in (trained, network)
    )
    assert after < 0.8 * before


@pytest.mark.parametrize("way", ["slopes", "displacement"])
def test_forces_get_better_by_weights_that_have_not_seen_the_press(
    tiny_data, make_scene, trained, of_slopes, monkeypatch, way
):
    """Than by the same training with hardly any weight of the force."""
    for size in ("SLOPES_SIZE", "DISPLACEMENT_SIZE"):
        monkeypatch.setattr(force_features, size, 2)  # for nine presses
    keys = of_slopes if way == "slopes" else {"outputs": ["force_xyz"], "force": {"kernel_size": 1}}
    errors, train = [], tiny_data.indices("train")
    for weight in (1e-9, 100.0):
        scene = make_scene(**keys, training={"force_weight": weight})
        frames = WholeFrames(tiny_data, tiny_data, scene, rest_depth_mm(scene.sensor))
        network = copy.deepcopy(trained)
        assert len(sums_of_slopes.fit(network, frames, train, epochs=30, rate=5e-3)) == 30
        frames.prepare(network)
        _, slopes, at_rest = frames._found(network, train)
        features = frames._force_features(slopes, at_rest, frames._depth(slopes, at_rest), WHOLE)
        errors.append(frames._force.error(features, train).item())
    assert errors[1] < 0.8 * errors[0]


def test_the_same_seed_gives_the_same_network(skins, trained):
    found = []
    for _ in range(2):
        network = copy.deepcopy(trained)
        sums_of_slopes.train(network, skins(depth_weight=1.0, depth_epochs=2, normals_share=0.5))
        found.append(parameters(network))
    assert torch.equal(*found)
    assert not torch.equal(found[0], parameters(trained))


@pytest.mark.parametrize(
    ("weights", "share"),
    [
        ({"depth_weight": 1.0}, 0.5),
        ({"depth_weight": 1.0, "force_weight": 0.1}, 0.5),
        ({"force_weight": 0.1}, 1.0),
    ],
)
def test_an_epoch_sees_a_share_of_the_frames_where_the_depth_counts(
    skins, trained, monkeypatch, weights, share
):
    seen = []
    monkeypatch.setattr(sums_of_slopes, "fit", lambda *_, share, **__: seen.append(share) or [])
    sums_of_slopes.train(copy.deepcopy(trained), skins(**weights, normals_share=0.5))
    assert seen == [share]


def test_a_training_that_loses_leaves_the_network_as_it_was(skins, trained):
    network = copy.deepcopy(trained)
    sums_of_slopes.train(network, skins(depth_weight=1.0, depth_epochs=1, depth_learning_rate=100.0))
    assert torch.equal(parameters(network), parameters(trained))


@pytest.mark.parametrize("key", ["rounding_noise", "weight_rounding_noise"])
def test_the_network_feels_rounding_where_the_scene_says_so(skins, trained, key):
    found = []
    for noise in (False, True):
        network = copy.deepcopy(trained)
        sums_of_slopes.train(network, skins(depth_weight=1.0, depth_epochs=1, **{key: noise}))
        found.append(parameters(network))
    assert not torch.equal(*found)


def test_nothing_to_learn_from_is_an_error(skins, trained):
    with pytest.raises(ValueError, match="valid: no frame to train on"):
        sums_of_slopes.fit(trained, skins(depth_weight=1.0), np.array([], int), epochs=1, rate=1e-3)
