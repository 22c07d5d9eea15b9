"""Forces of features, by weights that have not seen the press."""

import numpy as np
import pytest
import torch
from scipy.fft import dctn

from fastac.models.training.whole_frames.force_features import OfSlopes
from fastac.models.training.whole_frames.held_out_force import PARTS, HeldOutForce

SHAPE = (12, 10)
PRESSES, LOADS = 60, 3
LEARNED = np.arange(PRESSES * LOADS)
"""The frames after these are of presses that were held out."""


@pytest.fixture
def change() -> np.ndarray:
    """Slopes' changes of frames, three of a press."""
    rng = np.random.default_rng(1)
    return rng.normal(size=(PRESSES * LOADS + 8, *SHAPE, 2)).astype(np.float32)


def made(force_n: np.ndarray, learned: np.ndarray = LEARNED) -> HeldOutForce:
    together = np.arange(len(force_n)) // LOADS
    return HeldOutForce(force_n, together, learned)


def features_of(change: np.ndarray) -> torch.Tensor:
    return OfSlopes(SHAPE)(torch.from_numpy(change))


def smooth_force_n(change: np.ndarray) -> np.ndarray:
    """Forces along two axes by weights that are sums of a few cosines."""
    lowest = dctn(change, axes=(1, 2), norm="ortho")[:, :3, :2]
    weights = np.random.default_rng(2).normal(size=(2, 3, 2, 2))
    return np.einsum("nijt,aijt->na", lowest, weights).astype(np.float32)


def test_smooth_weights_are_found(change):
    force_n = smooth_force_n(change)
    model = made(force_n)
    features = features_of(change)
    model.refit(features[LEARNED])
    every = np.arange(len(change))
    assert model.error(features, every) < 0.05 * np.abs(force_n).sum(axis=1).mean()


def test_a_press_is_no_part_of_the_weights_that_find_its_force(change):
    """Another force of one press changes the weights of all others, and not its own."""
    force_n = smooth_force_n(change)
    model = made(force_n)
    features = features_of(change)[LEARNED]
    model.refit(features)
    before = model.weights.clone()
    force_n[:LOADS] += 10.0
    other = made(force_n)
    other.refit(features)
    own = model.part[0]
    assert (model.part[:LOADS] == own).all()
    assert torch.equal(other.weights[own], before[own])
    for part in set(range(PARTS + 1)) - {own}:
        assert not torch.allclose(other.weights[part], before[part])


def test_presses_are_divided_evenly_and_held_out_frames_see_all(change):
    model = made(smooth_force_n(change))
    assert np.bincount(model.part[LEARNED]).tolist() == [len(LEARNED) // PARTS] * PARTS
    assert (model.part[len(LEARNED) :] == PARTS).all()


def test_frames_that_are_learned_by_heart_count_by_what_others_say(change):
    """Forces that have nothing to do with the slopes: no fit makes them smaller."""
    force_n = np.random.default_rng(3).normal(size=(len(change), 1)).astype(np.float32)
    model = made(force_n)
    features = features_of(change)[LEARNED]
    model.refit(features)
    held_out = model.error(features, LEARNED).item()
    model.part[:] = PARTS  # the weights that have seen all of them
    assert model.error(features, LEARNED).item() < 0.7 * np.abs(force_n).mean() < 0.8 * held_out


def test_one_press_alone_is_fitted_to_itself(change):
    model = made(smooth_force_n(change), LEARNED[:LOADS])
    features = features_of(change)[:LOADS]
    model.refit(features)
    assert torch.isfinite(model.weights).all()
    assert model.error(features, LEARNED[:LOADS]) < 0.1
