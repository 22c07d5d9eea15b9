"""Training from forces alone, on simulated presses without labelled normals and depth."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict, slopes_of
from fastac.models.integer.features import integer_features
from fastac.models.training import from_forces, smooth_weights
from fastac.models.training.from_forces import (
    ForceFromPixels,
    channel_mixtures,
    distillation_pixels,
    linear_network,
)
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


def test_a_linear_network_has_the_mixtures_for_slopes():
    torch.manual_seed(1)
    mixtures = np.random.default_rng(1).normal(size=(2, 4)).astype(np.float32)
    network = linear_network(mixtures)
    background = np.full((16, 16, 4), 100, np.uint8)
    frames = np.random.default_rng(2).integers(60, 140, (2, 16, 16, 4), dtype=np.uint8)
    slopes = slopes_of(predict(network, integer_features(frames, background)), 1e6)
    expected = (frames.astype(float) - background) / 64 @ mixtures.T
    np.testing.assert_allclose(slopes, expected, atol=1e-5)
    assert all(layer.weight[4:].any() for layer in network.linear_layers[:-1])


def test_mixtures_span_what_fields_of_rank_two_use():
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(2, 3))
    fields = rng.normal(size=(1, 8, 8, 2)) @ truth
    change = rng.normal(size=(50, 8, 8, 3)) * (10, 3, 1)
    mixtures = channel_mixtures(fields, change)
    np.testing.assert_allclose(truth @ np.linalg.pinv(mixtures) @ mixtures, truth, atol=1e-4)
    steepest = np.quantile(np.abs(change.reshape(-1, 3) @ mixtures.T), 1 - 1e-4, axis=0)
    np.testing.assert_allclose(steepest, from_forces.INITIAL_SLOPE)


def test_blocks_leave_enough_of_a_frame():
    sizes = [(16, 16), (40, 44), (64, 64), (128, 128), (256, 256), (96, 128), (100, 128), (66, 66)]
    assert [from_forces.block_size(*size) for size in sizes] == [1, 2, 2, 4, 8, 4, 4, 2]


class TestForceFromPixels:
    SHAPE = (64, 64, 3)

    @pytest.fixture
    def model(self):
        rng = np.random.default_rng(1)
        torch.manual_seed(1)
        network = linear_network(rng.normal(size=(2, 3)).astype(np.float32))
        return ForceFromPixels(network, rng.normal(size=(2, 4, 4, 2)), self.SHAPE, 1e3)

    def test_rest_is_no_force(self, model):
        with torch.no_grad():
            for layer in model.network.linear_layers:
                layer.weight += 0.1
            assert not model(torch.zeros(1, 32, 32, 3)).any()
            assert model(torch.ones(1, 32, 32, 3)).any()

    def test_averaged_frames_have_the_force_of_whole_ones_where_all_is_linear(self, model):
        """Exact for frames that are constant within each block."""
        background = np.full(self.SHAPE, 100, np.uint8)
        coarse = np.random.default_rng(2).integers(80, 120, (3, 32, 32, 3), dtype=np.uint8)
        frames = coarse.repeat(2, axis=1).repeat(2, axis=2)
        slopes = slopes_of(predict(model.network, integer_features(frames, background)), 1e3)
        waves = smooth_weights.cosine_basis(64, 4)
        fields = model.fields.detach().numpy() * model.unit / 4
        weights = np.einsum("ik,jl,aklt->aijt", waves, waves, fields)
        change = from_forces.block_averages(frames.astype(np.float32) - background, 2)
        np.testing.assert_array_equal(change, coarse.astype(np.float32) - 100)
        with torch.inference_mode():
            found = model(torch.from_numpy(change)).numpy()
        np.testing.assert_allclose(found, np.einsum("nijt,aijt->na", slopes, weights), rtol=1e-3, atol=1e-3)


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
    begin = from_forces.initial_model(forces_only, wild)
    network, history = from_forces.train(forces_only, wild)
    assert min(history, key=lambda entry: entry["validation_mae_n"])["epoch"] == 0
    for a, b in zip(network.linear_layers, begin.network.linear_layers, strict=True):
        torch.testing.assert_close(a.weight, b.weight)


def test_training_is_repeatable_and_noise_and_light_change_it(forces_only, scene):
    def errors(**changes):
        training = scene.training.model_copy(update=changes)
        _, history = from_forces.train(forces_only, scene.model_copy(update={"training": training}))
        return [entry["train_mae_n"] for entry in history[1:]]

    first = errors()
    assert errors() == first
    assert errors(input_noise=0.1) != first
    assert errors(light_noise=0.0) != first


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


def test_integers_learn_from_what_the_network_finds(forces_only):
    torch.manual_seed(1)
    network = linear_network(np.random.default_rng(1).normal(size=(2, 3)).astype(np.float32))
    pixels = distillation_pixels(network, forces_only, limit=100 * 50)
    assert set(pixels) == {"train", "validation"}
    x, y = pixels["train"]
    assert x.shape == (100 * 50, 5)
    found = predict(network, x)
    np.testing.assert_allclose(y, found / np.linalg.norm(found, axis=1, keepdims=True), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(pixels["validation"][1], axis=1), 1, atol=1e-6)
