"""What is left of dots' shifts without the rigid motion that fits them: against a general solver."""

import numpy as np
import pytest

from fastac.models.vision.rigid_spread import rigid_spread_px


def by_solver(place_px: np.ndarray, shift_px: np.ndarray) -> float:
    """With NumPy's least squares: columns for both translations and the rotation."""
    one, none = np.ones(len(place_px)), np.zeros(len(place_px))
    u = np.stack([one, none, -place_px[:, 1]], axis=-1)
    v = np.stack([none, one, place_px[:, 0]], axis=-1)
    matrix, wanted = np.concatenate([u, v]), shift_px.T.ravel()
    rest = wanted - matrix @ np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    return float(np.sqrt((rest**2).sum() / len(place_px)))


@pytest.mark.parametrize("count", [3, 4, 30])
def test_equals_a_general_solver(count):
    rng = np.random.default_rng(count)
    place, shift = rng.uniform(0, 128, (count, 2)), rng.normal(size=(count, 2))
    found = rigid_spread_px(place, shift)
    assert found == pytest.approx(by_solver(place, shift), rel=1e-9)
    assert found > 0.1


def test_a_rigid_motion_leaves_nothing_and_a_stretch_does():
    place = np.random.default_rng(1).uniform(0, 128, (20, 2))
    moved = np.array([3.0, -1.0]) + 0.02 * np.stack([-place[:, 1], place[:, 0]], axis=-1)
    assert rigid_spread_px(place, moved) < 1e-12
    arm = place - place.mean(axis=0)
    stretched = rigid_spread_px(place, moved + 0.02 * place)
    assert stretched == pytest.approx(0.02 * np.sqrt((arm**2).sum() / 20))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_dots_have_no_spread(count):
    assert rigid_spread_px(np.arange(2.0 * count).reshape(count, 2), np.eye(2)[:count]) == 0
