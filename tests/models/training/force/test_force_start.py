"""The linear models that training from forces alone begins with."""

import numpy as np
import pytest
import torch

from fastac.models.floating.network import predict, slopes_of
from fastac.models.integer.features import integer_features
from fastac.models.training.force import force_start, ridge
from fastac.models.training.force.force_start import (
    force_mixtures,
    linear_network,
    linear_start,
    surface_mixtures,
)
from fastac.models.training.force.smooth_weights import SmoothWeights
from tests.models.training.force.test_press_symmetry import recordings


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
    mixtures = force_mixtures(fields, change)
    np.testing.assert_allclose(truth @ np.linalg.pinv(mixtures) @ mixtures, truth, atol=1e-4)
    steepest = np.quantile(np.abs(change.reshape(-1, 3) @ mixtures.T), 1 - 1e-4, axis=0)
    np.testing.assert_allclose(steepest, force_start.INITIAL_SLOPE)


def test_slopes_of_surfaces_have_one_scale(dents):
    slopes, mixing = dents
    change = slopes @ mixing
    mixtures = surface_mixtures(change)
    assert np.quantile(np.abs(change @ mixtures.T), 1 - 1e-4) == pytest.approx(force_start.INITIAL_SLOPE)


@pytest.fixture
def scene(make_scene):
    """A function that returns a scene that learns from forces, with these keys of its training."""
    keys = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}, "sensor": {"channels": "bgr"}}
    keys["force"] = {"clamp": False, "fit": "slopes"}
    return lambda **training: make_scene(**keys, training={"labels": "force", **training})


class TestLinearStart:
    @staticmethod
    def presses(slopes, mixing):
        """Differences and forces by split: the force is the volume of the dents, Σ (x·p + y·q)."""
        at = np.arange(slopes.shape[1]) - (slopes.shape[1] - 1) / 2
        force_n = (slopes[..., 0] * at).sum((1, 2)) + (slopes[..., 1] * at[:, None]).sum((1, 2))
        noise = 0.02 * np.random.default_rng(5).standard_normal((*slopes.shape[:3], mixing.shape[1]))
        change = (slopes @ mixing + noise).astype(np.float32)
        parts = {"train": slice(0, 90), "validation": slice(90, None)}
        return (
            {split: change[part] for split, part in parts.items()},
            {split: force_n[part, None] for split, part in parts.items()},
        )

    def test_it_begins_with_the_slopes_of_surfaces(self, dents, scene):
        slopes, mixing = dents
        start = linear_start(*self.presses(slopes, mixing), scene())
        assert start.of_surfaces
        found = slopes @ mixing @ start.mixtures.T
        assert abs(np.corrcoef(found.reshape(-1, 2).T, slopes.reshape(-1, 2).T)[0, 2]) > 0.99

    def test_errors_on_recordings_left_out_decide_where_several_are_known(self, dents, scene, monkeypatch):
        slopes, mixing = dents
        change, force_n = self.presses(slopes, mixing)
        group = {split: np.arange(len(values)) % 3 for split, values in force_n.items()}
        monkeypatch.setattr(force_start, "JUDGED_COSINES", 2)
        start = linear_start(change, force_n, scene(press_symmetry=False), group)
        assert start.of_surfaces
        mixed = {s: (x @ start.mixtures.T).astype(np.float32) for s, x in change.items()}
        history = SmoothWeights(mixed, force_n, robust=True).errors(recording=group, largest=2)
        assert start.left_out_mae_n == ridge.best(history)["validation_mae_n"]
        errors = iter((1.0, 1.001))
        monkeypatch.setattr(force_start, "_left_out_mae_n", lambda *_, **__: next(errors))
        assert not linear_start(change, force_n, scene(), group).of_surfaces
        assert linear_start(change, force_n, scene()).left_out_mae_n is None

    def test_slopes_are_judged_with_the_symmetry_that_the_last_fit_gives_them(self, scene):
        """Presses on one side of the image. Other mixtures use a noisy third channel, which gets brighter
        with the force as no surface's does; that is worth less than the symmetry."""
        slopes, force_n, group = recordings()
        rng = np.random.default_rng(8)

        def seen(split: str) -> np.ndarray:
            brighter = force_n[split][..., None] / 1200 + rng.standard_normal(slopes[split].shape[:3])
            return np.concatenate([slopes[split], brighter[..., None]], axis=-1).astype(np.float32)

        change = {split: seen(split) for split in slopes}
        plain, symmetric = (
            linear_start(change, force_n, scene(press_symmetry=keys), group) for keys in (False, True)
        )
        assert not plain.of_surfaces
        assert symmetric.of_surfaces
        assert symmetric.left_out_mae_n < 0.97 * plain.left_out_mae_n

    def test_without_a_weight_of_the_curl_it_begins_with_what_explains_the_force(self, dents, scene):
        assert not linear_start(*self.presses(*dents), scene(curl_weight=0.0)).of_surfaces

    def test_images_of_no_surface_begin_with_what_explains_the_force(self, dents, scene):
        """Two channels carry the force, and their curl is large; the third, a surface's, carries none."""
        slopes, _ = dents
        rng = np.random.default_rng(4)
        change, force_n = self.presses(slopes, np.eye(2, 3))
        for split, pixels in change.items():
            noise = 5 * rng.standard_normal((*pixels.shape[:3], 2))
            force_n[split] = noise.sum(axis=(1, 2))[:, :1]
            pixels[..., 2] = noise[..., 0]
        start = linear_start(change, force_n, scene())
        assert not start.of_surfaces
        assert start.validation_mae_n < 0.5 * np.abs(force_n["validation"]).mean()
