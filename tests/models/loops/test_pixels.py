"""Edge cases of the per-pixel loops that no rendered frame reaches; the pipelines' tests cover the others."""

import numpy as np
import pytest

from fastac.models.floating.network import slopes_of
from fastac.models.loops.pixels import limited_slopes, unit_normals


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_slopes_of_any_normals(real):
    values = np.array([-np.inf, -3, -1e-30, 0, 1e-30, 0.25, 2, np.inf], real)
    normal = np.stack(np.meshgrid(values, values, values)).reshape(3, -1)
    found = np.empty((2, normal.shape[1]), real)
    limited_slopes(normal, real(4), found)
    np.testing.assert_array_equal(found, slopes_of(normal.T, 4).T)


def test_unit_normals_of_short_ones():
    normal = np.array([[3.0, 0.0, 0.25], [4.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = np.empty(9)
    unit_normals(normal, 1.0, found)
    np.testing.assert_array_equal(found.reshape(3, 3), [[0.6, 0.8, 0], [0, 0, 0], [0.25, 0, 0]])
