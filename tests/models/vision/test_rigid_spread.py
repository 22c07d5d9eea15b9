import numpy as np
import pytest

from fastac.models.vision.rigid_spread import rigid_spread_px

PLACES = np.array([[0.0, 0], [10, 0], [0, 10], [10, 10]])


def test_one_dot_that_lags_behind():
    """Of four dots at a square's corners one moves by 1 px more; a shift and a turn of all take a part."""
    shift = np.tile([3.0, -2.0], (4, 1))
    shift[0, 0] += 1
    # Residual of a least-squares fit by translation and rotation, by numpy.
    columns = np.zeros((8, 3))
    columns[::2, 0] = columns[1::2, 1] = 1
    columns[::2, 2], columns[1::2, 2] = -PLACES[:, 1], PLACES[:, 0]
    _, (residual,), *_ = np.linalg.lstsq(columns, shift.ravel(), rcond=None)
    assert rigid_spread_px(PLACES, shift) == pytest.approx(np.sqrt(residual / 4))


def test_a_rotation_and_two_dots_have_none():
    turned = 0.01 * np.stack([-PLACES[:, 1], PLACES[:, 0]], axis=-1) + 5
    assert rigid_spread_px(PLACES, turned) == pytest.approx(0, abs=1e-12)
    assert rigid_spread_px(PLACES[:2], np.array([[0.0, 0], [9, 9]])) == 0
