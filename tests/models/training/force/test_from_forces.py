"""Training from forces alone, on simulated presses without labelled normals and depth."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict, slopes_of
from fastac.models.integer.features import integer_features
from fastac.models.training.force import from_forces, smooth_weights
from fastac.models.training.force.force_start import (
    background_differences,
    initial_model,
    linear_network,
    linear_start,
)
from fastac.models.training.force.from_forces import distillation_pixels
from fastac.sensor import dataset
from fastac.sensor.fingertip import generate


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(
        outputs=["force_z"],
        sensor={"channels": "bgr"},
        poisson={"solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        protocol={"train_grid": 5, "validation_grid": 3, "test_grid": 3, "loads_n": [0.01, 0.03, 0.05, 0.07]},
        training={"labels": "force", "force_epochs": 3, "force_batch": 10, "force_learning_rate": 1e-3},
    )


@pytest.fixture(scope="module")
def forces_only(scene, tmp_path_factory):
    """100 presses for training, 36 for validation and 36 for the test, without labelled normals and depth."""
    path = tmp_path_factory.mktemp("forces") / "d.h5"
    generate(scene, path, progress=False, processes=1)
    return replace(dataset.read(path, scene), normals=None, indenter=None)


class TestDisturbance:
    CHANGE = torch.randn((200, 4, 5, 3), generator=torch.Generator().manual_seed(3)) * torch.tensor(
        (1, 5, 20)
    )
    BACKGROUND = torch.full((4, 5, 3), 100.0)

    def disturbed(self, make_scene, **training):
        """The batch CHANGE disturbed, less itself."""
        settings = make_scene(training=training).training
        generator = torch.Generator().manual_seed(1)
        disturb = from_forces.Disturbance(settings, self.CHANGE, self.BACKGROUND, generator)
        return disturb(self.CHANGE) - self.CHANGE

    @pytest.fixture
    def make_scene(self, make_scene):
        keys = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}, "sensor": {"channels": "bgr"}}
        keys["force"] = {"clamp": False, "fit": "slopes"}
        return lambda training: make_scene(**keys, training={"labels": "force", **training})

    def test_another_light_is_a_gain_of_each_channel_of_a_frame(self, make_scene):
        added = self.disturbed(make_scene, light_noise=0.05)
        gains = (added / (self.CHANGE + self.BACKGROUND)).flatten(1, 2)
        assert (gains.std(dim=1) < 1e-3 * gains.abs().amax(dim=1) + 1e-6).all()  # alike in all pixels
        of_frames = gains.mean(dim=1)
        torch.testing.assert_close(of_frames.std(dim=0), torch.full((3,), 0.05), rtol=0.2, atol=0)
        assert np.abs(np.corrcoef(of_frames.T)[~np.eye(3, dtype=bool)]).max() < 0.3

    def test_noise_of_pixels_is_a_fraction_of_each_channel_s_spread(self, make_scene):
        added = self.disturbed(make_scene, light_noise=0.0, input_noise=0.1)
        torch.testing.assert_close(
            added.std(dim=(0, 1, 2)), 0.1 * torch.tensor((1.0, 5.0, 20.0)), rtol=0.1, atol=0
        )

    def test_without_either_nothing_changes(self, make_scene):
        assert not self.disturbed(make_scene, light_noise=0.0).any()


def test_forces_of_unseen_presses_are_found(forces_only, scene):
    """With weights fitted to the trained slopes, the error is far below that of the mean training force."""
    network, history = from_forces.train(forces_only, scene)
    assert [entry["epoch"] for entry in history] == [0, 1, 2, 3]

    def change(split):
        frames = np.concatenate(
            [forces_only.frames[forces_only.indices(split)], forces_only.background[None]]
        )
        slopes = slopes_of(predict(network, integer_features(frames, forces_only.background)), 4)
        return slopes[:-1] - slopes[-1:]

    splits = ("train", "validation", "test")
    force = {split: forces_only.forces_n(forces_only.indices(split), (2,)) for split in splits}
    weights, *_ = smooth_weights.fit({s: change(s) for s in splits[:2]}, {s: force[s] for s in splits[:2]})
    error = np.abs(np.einsum("nijt,aijt->na", change("test"), weights) - force["test"]).mean()
    assert error < 0.4 * np.abs(force["test"] - force["train"].mean()).mean()


def test_the_best_on_validation_is_kept(forces_only, scene):
    """With this learning rate training is worse than the initial linear model, which must be kept."""
    wild = scene.model_copy(
        update={
            "training": scene.training.model_copy(update={"normals_learning_rate": 10.0, "light_noise": 0.0})
        }
    )
    torch.manual_seed(wild.training.seed)
    splits = {split: forces_only.indices(split) for split in ("train", "validation")}
    change = {split: background_differences(forces_only, index) for split, index in splits.items()}
    force = {split: forces_only.forces_n(index, (2,)) for split, index in splits.items()}
    begin = initial_model(linear_start(change, force, wild), forces_only, wild)
    network, history = from_forces.train(forces_only, wild)
    assert min(history, key=lambda entry: entry["validation_mae_n"])["epoch"] == 0
    for a, b in zip(network.linear_layers, begin.network.linear_layers, strict=True):
        torch.testing.assert_close(a.weight, b.weight)


def test_half_of_what_training_changes_is_kept(forces_only, scene, monkeypatch):
    assert from_forces.TRAINED_SHARE == 0.5

    def parameters(share):
        monkeypatch.setattr(from_forces, "TRAINED_SHARE", share)
        network, history = from_forces.train(forces_only, scene)
        assert min(history, key=lambda entry: entry["validation_mae_n"])["epoch"] > 0
        return [values.detach() for values in network.parameters()]

    kept, start, trained = (parameters(share) for share in (0.5, 0.0, 1.0))
    for middle, first, last in zip(kept, start, trained, strict=True):
        torch.testing.assert_close(middle, (first + last) / 2)
    assert any(not torch.equal(first, last) for first, last in zip(start, trained, strict=True))


def test_training_is_repeatable_and_noise_and_light_change_it(forces_only, scene):
    def errors(**changes):
        training = scene.training.model_copy(update=changes)
        _, history = from_forces.train(forces_only, scene.model_copy(update={"training": training}))
        return [entry["train_mae_n"] for entry in history[1:]]

    first = errors()
    assert errors() == first
    assert errors(input_noise=0.1) != first
    assert errors(light_noise=0.0) != first


def test_the_weight_of_the_curl_counts_where_it_begins_with_surfaces(forces_only, scene):
    def curve(**changes):
        training = scene.training.model_copy(update=changes)
        return from_forces.train(forces_only, scene.model_copy(update={"training": training}))[1][1:]

    assert curve(curl_weight=10.0) != curve(curl_weight=1.0)


@pytest.mark.full
def test_it_stops_when_patience_ends_and_the_mean_of_the_weights_is_kept(forces_only, scene):
    """With a rate that no step survives, the mean over an epoch is worse too: the start is what is kept."""
    keys = {"force_epochs": 12, "patience_epochs": 2, "light_noise": 0.0}
    wild = scene.model_copy(
        update={"training": scene.training.model_copy(update={**keys, "normals_learning_rate": 10.0})}
    )
    _, history = from_forces.train(forces_only, wild)
    assert [entry["epoch"] for entry in history] == [0, 1, 2]
    tame = scene.model_copy(update={"training": scene.training.model_copy(update=keys)})
    (_, history), (_, again) = (from_forces.train(forces_only, tame) for _ in range(2))
    assert history[1:] == again[1:]
    errors = [entry["validation_mae_n"] for entry in history]
    best = int(np.argmin(errors))
    assert errors[best] < errors[0]
    assert len(history) == min(12, best + 2) + 1
    # Rates that stay and an average, not the cycle that ends with the last epoch.
    whole = scene.model_copy(update={"training": scene.training.model_copy(update={"light_noise": 0.0})})
    cycle = from_forces.train(forces_only, whole)[1]
    assert cycle[1]["validation_mae_n"] != errors[1]


def test_without_validation_the_last_is_kept(forces_only, scene):
    split = np.where(forces_only.split == "validation", "train", forces_only.split)
    _, history = from_forces.train(replace(forces_only, split=split), scene)
    assert [set(entry) for entry in history] == [{"epoch", "train_mae_n"}] * 3


@pytest.mark.parametrize("smoothing_px", [0, 4])
def test_integers_learn_from_what_the_network_finds(forces_only, smoothing_px):
    torch.manual_seed(1)
    network = linear_network(np.random.default_rng(1).normal(size=(2, 3)).astype(np.float32))
    pixels = distillation_pixels(network, forces_only, smoothing_px=smoothing_px, limit=100 * 50)
    assert set(pixels) == {"train", "validation"}
    x, y = pixels["train"]
    assert x.shape == (100 * 50, 5)
    frame = forces_only.frames[forces_only.indices("train")[0]]
    seen = integer_features(frame, forces_only.background, smoothing_px).reshape(-1, 5).tolist()
    assert {tuple(pixel) for pixel in x[:50].tolist()} <= {tuple(pixel) for pixel in seen}
    found = predict(network, x)
    np.testing.assert_allclose(y, found / np.linalg.norm(found, axis=1, keepdims=True), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(pixels["validation"][1], axis=1), 1, atol=1e-6)
