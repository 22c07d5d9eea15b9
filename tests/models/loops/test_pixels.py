"""Edge cases of the per-pixel loops that no rendered frame reaches; the pipelines' tests cover the others."""

import numpy as np
import pytest

from fastac.models.floating.network import slopes_of
from fastac.models.integer.laplacian import STENCILS, divergence_of
from fastac.models.loops.pixels import framed_depth, limited_slopes, source, unit_normals


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_slopes_of_any_normals(real):
    values = np.array([-np.inf, -3, -1e-30, 0, 1e-30, 0.25, 2, np.inf], real)
    normal = np.stack(np.meshgrid(values, values, values)).reshape(3, -1)
    found = np.empty((2, normal.shape[1]), real)
    for k in range(2):
        limited_slopes(normal[k], normal[2], real(4), found[k])
    np.testing.assert_array_equal(found, slopes_of(normal.T, 4).T)


def test_unit_normals_of_short_ones():
    normal = np.array([[3.0, 0.0, 0.25], [4.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = np.empty(9)
    unit_normals(normal, 1.0, found)
    np.testing.assert_array_equal(found.reshape(3, 3), [[0.6, 0.8, 0], [0, 0, 0], [0.25, 0, 0]])


@pytest.mark.parametrize("divergence", STENCILS)
@pytest.mark.parametrize("shape", [(3, 3), (7, 6), (12, 9)])
def test_rows_of_the_source_are_those_of_the_whole(shape, divergence):
    rng = np.random.default_rng(1)
    slopes = rng.integers(-99, 100, (*shape, 2)).astype(float)
    offset = rng.integers(-99, 100, (shape[0] - 2, shape[1] - 2)).astype(float)
    expected = divergence_of(slopes, divergence) * 0.5 - offset
    planes = np.ascontiguousarray(np.moveaxis(slopes, -1, 0).reshape(2, -1))
    found = np.empty_like(expected)
    for first in range(0, len(found), 2):
        rows = found[first : first + 2].reshape(-1)
        source(planes, shape[1], first, STENCILS[divergence].ahead, 0.5, offset.reshape(-1), rows)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("absolute", [True, False])
def test_depth_is_framed_by_the_skin_at_rest(absolute):
    """In bands of any number of rows, in whatever order."""
    rng = np.random.default_rng(1)
    z, rest = rng.integers(-9, 10, (2, 5, 5)).astype(float)
    rest_mm = rng.normal(size=(7, 7)).astype(np.float32)
    expected = rest_mm.copy()
    expected[1:-1, 1:-1] = (z if absolute else rest + z) * 0.25
    found = np.full((7, 7), np.nan, np.float32)
    for first, last in ((3, 5), (0, 1), (1, 3)):
        part, known = z[first:last].reshape(-1), rest[first:last].reshape(-1)
        framed_depth(part, 7, first, known, absolute, 0.25, rest_mm.reshape(-1), found.reshape(-1))
    np.testing.assert_array_equal(found, expected)
