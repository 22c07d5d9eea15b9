"""Least squares on a few presses at a time: each step is a Gauss-Newton step, and earlier presses count."""

import numpy as np
import pytest

from fastac.models.training.whole_frames import force_filter
from fastac.models.training.whole_frames.force_filter import CHANGE, LONGEST, SHORTEST, ForceFilter, learn
from fastac.models.training.whole_frames.force_residual import ForceResidual
from fastac.models.training.whole_frames.pixel_grid import WHOLE


@pytest.fixture
def whole(monkeypatch) -> None:
    """Derivatives are those of all pixels, and steps of any length."""
    monkeypatch.setattr(force_filter, "PARTS", 1)
    monkeypatch.setattr(force_filter, "LARGEST_STEP", 1e9)


def errors_mn(state: ForceFilter, index: np.ndarray) -> float:
    return 1e3 * np.abs(state.errors_n(index)).mean()


@pytest.mark.usefixtures("whole")
def test_an_update_from_presses_alone_is_a_damped_gauss_newton_step(residual):
    """The least squares of errors that are linear in network and weights, and of the changes themselves."""
    index, state = residual.index, ForceFilter(residual)
    parameters, weights = state.parameters, state.weights
    features, _ = residual.fitted(parameters)
    spread, errors_n = np.sqrt((features**2).mean(axis=0)), state.errors_n(index)
    by_network, count = residual.derivatives(weights, WHOLE), len(parameters)
    rows = np.zeros((*errors_n.shape, count + weights.size))
    for axis in range(3):
        rows[:, axis, :count] = by_network[:, axis]
        rows[:, axis, count + axis * len(weights) :][:, : len(weights)] = features
    damped = np.diag(np.concatenate([np.ones(count), *[spread] * 3]))
    damped *= np.sqrt((errors_n**2).mean()) / CHANGE
    stacked = np.concatenate([rows.reshape(-1, len(damped)), damped])
    expected = np.linalg.lstsq(stacked, np.concatenate([errors_n.ravel(), np.zeros(len(damped))]))[0]
    np.testing.assert_array_equal(state.update(index, kept=0), errors_n)
    np.testing.assert_allclose(parameters - state.parameters, expected[:count], atol=1e-6)
    np.testing.assert_allclose((weights - state.weights).T.ravel(), expected[count:], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("residual", ["skin"], indirect=True)
def test_weights_are_those_of_all_presses_that_are_not_forgotten(residual, monkeypatch):
    """Of a network that nothing changes: least squares, one after another, find what those of all find."""
    monkeypatch.setattr(force_filter, "CHANGE", 1e3)
    monkeypatch.setattr(
        ForceResidual, "derivatives", lambda self, *_: np.zeros((len(self.index), 3, len(self.parameters)))
    )
    earlier, later = residual.index[::2], residual.index[1::2]
    for kept, seen in ((1.0, residual.index), (0.0, later)):
        state = ForceFilter(residual)
        state.update(earlier, kept=0)
        state.update(later, kept)
        expected = np.linalg.lstsq(residual.features(seen), residual.force_n(seen))[0]
        np.testing.assert_allclose(state.weights, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def test_no_step_is_longer_than_the_largest(residual, monkeypatch):
    state = ForceFilter(residual)
    start = state.parameters
    monkeypatch.setattr(force_filter, "LARGEST_STEP", 1e-3)
    state.update(residual.index, kept=0.5)
    assert np.linalg.norm(state.parameters - start) == pytest.approx(1e-3)


def test_presses_without_error_change_nothing(residual, monkeypatch):
    """As a frame at rest, whose force is none and is found to be none."""
    state = ForceFilter(residual)
    start, state.weights = state.parameters, np.zeros_like(state.weights)
    monkeypatch.setattr(ForceResidual, "force_n", lambda self, index: np.zeros((len(index), 3)))
    assert not state.update(residual.index[:2], kept=0).any()
    np.testing.assert_array_equal(state.parameters, start)
    assert not state.weights.any()


def test_a_pass_sees_each_press_once_and_later_passes_remember_more_of_them(residual, monkeypatch):
    seen, told = [], []

    def watched(self, index, kept):
        seen.append((index, kept))
        return np.full((len(index), 3), 0.25)

    monkeypatch.setattr(ForceFilter, "update", watched)
    monkeypatch.setattr(force_filter, "UPDATES", 9)
    updates = []
    found = learn(residual, 5, lambda: updates.append(1), lambda state, error_n: told.append(error_n))
    np.testing.assert_array_equal(found, residual.parameters)
    assert told == [0.75] * 5
    assert len(updates) == len(seen) == 5 * 9
    orders = [np.concatenate([index for index, _ in seen[9 * k :][:9]]) for k in range(5)]
    for order in orders:
        np.testing.assert_array_equal(np.sort(order), residual.index)
    assert not np.array_equal(orders[0], orders[1])
    memory = [1 / (9 * (1 - kept)) for _, kept in seen[::9]]
    assert memory == pytest.approx([SHORTEST] * 3 + [(SHORTEST * LONGEST) ** 0.5, LONGEST])


def test_passes_lower_the_error_and_the_same_seed_finds_the_same(residual):
    before = errors_mn(ForceFilter(residual), residual.index)
    start, found, after = residual.parameters, [], []
    for _ in range(2):
        residual.set(start)
        end = learn(
            residual, 6, lambda: None, lambda state, _: after.append(errors_mn(state, residual.index))
        )
        found.append(end)
    assert after[5] < 0.7 * before
    assert after[6:] == after[:6]
    np.testing.assert_array_equal(*found)
