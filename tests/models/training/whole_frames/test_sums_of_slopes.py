"""Training with the error of depth or force: both become better on frames that were held out."""

import copy
import dataclasses
from collections.abc import Callable, Iterator

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


@pytest.fixture
def threads_of_torch() -> Iterator[Callable[[int], None]]:
    """Sets how many threads torch may use; they are as before at the end."""
    before = torch.get_num_threads()
    yield torch.set_num_threads
    torch.set_num_threads(before)


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
    ("keys", "share"),
    [
        ({"depth_weight": 1.0}, 0.5),
        ({"depth_weight": 1.0, "force_weight": 0.1}, 0.5),
        ({"force_weight": 0.1}, 1.0),
        ({"depth_weight": 1.0, "depth_share": 1.0}, 1.0),
        ({"force_weight": 0.1, "depth_share": 0.25}, 0.25),
    ],
)
def test_an_epoch_sees_a_share_of_the_frames(skins, trained, monkeypatch, keys, share):
    seen = []
    monkeypatch.setattr(sums_of_slopes, "fit", lambda *_, share, **__: seen.append(share) or [])
    sums_of_slopes.train(copy.deepcopy(trained), skins(**keys, normals_share=0.5))
    assert seen == [share]


def test_the_scene_chooses_the_optimiser(skins, trained):
    found = []
    for name in ("adam", "soap"):
        network = copy.deepcopy(trained)
        history = sums_of_slopes.train(network, skins(depth_weight=1.0, depth_epochs=6, depth_optimiser=name))
        assert history[-1]["train_loss"] < history[0]["train_loss"]
        found.append(parameters(network))
    assert not torch.equal(*found)


def test_of_several_trials_the_best_is_kept(skins, trained, tiny_data):
    """Of the smallest depth error on the presses of training and validation; its curve is returned."""
    frames = skins(depth_weight=1.0, depth_epochs=3, depth_trials=4)
    known = np.concatenate([tiny_data.indices(split) for split in ("train", "validation")])
    networks, curves, losses = [], [], []
    for trial in range(4):
        networks.append(copy.deepcopy(trained))
        split = {"index": tiny_data.indices("train"), "validation": tiny_data.indices("validation")}
        curves.append(sums_of_slopes.fit(networks[-1], frames, **split, epochs=3, rate=2e-3, trial=trial))
        with torch.no_grad():
            _, slopes, at_rest = frames._found(networks[-1], known)
            depth_px = frames._depth(slopes, at_rest)
            losses.append(frames._depth_error(depth_px, known).item())
    assert len(set(losses)) == 4
    network, best = copy.deepcopy(trained), int(np.argmin(losses))
    assert sums_of_slopes.train(network, frames) == curves[best]
    assert torch.equal(parameters(network), parameters(networks[best]))
    assert best, "the first is the best, so that this test could not tell"


@pytest.mark.full  # PyTorch is imported in another process
def test_side_by_side_the_same_trial_is_kept(skins, trained, threads_of_torch):
    """Bit for bit; and of the scene this process reads as much, for that is what a store records."""
    frames, found = skins(depth_weight=1.0, depth_epochs=2, depth_trials=4), []
    for threads in (1, 2):
        read: set[str] = set()
        watched = frames.scene.watched(lambda path, value, read=read: read.add(path))
        network = copy.deepcopy(trained)
        threads_of_torch(threads)
        history = sums_of_slopes.train(network, dataclasses.replace(frames, scene=watched))
        found.append((parameters(network).tolist(), history, read))
    assert found[0] == found[1]
    assert "training.depth_epochs" in found[0][2]


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
