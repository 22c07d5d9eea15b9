"""Folded transforms against products with the full matrix, on integers."""

import numpy as np
import pytest

from fastac.models.integer.bounds import coefficients
from fastac.models.integer.laplacian import sine_matrix
from fastac.models.loops.sines import (
    FoldedSine,
    fold_columns,
    fold_rows,
    is_foldable,
    round_and_scale,
    unfold_columns,
    unfold_rows,
)


@pytest.mark.parametrize("size", [1, 2, 3, 14, 15])
@pytest.mark.parametrize("half", [0.0, 0.5])
@pytest.mark.parametrize("extreme", [0, 1 << 25, None])
def test_equals_the_whole_product(size, half, extreme):
    """Inputs of zeros, of alternating extremes, and random ones; rounded to nearest and down."""
    rng = np.random.default_rng(1)
    signs = rng.choice([-1, 1], (size, size))
    x = rng.integers(-1000, 1001, (size, size)) if extreme is None else extreme * signs
    matrix = coefficients(size, 17)
    assert np.array_equal(matrix, matrix.T)

    def rounded(a, shift):
        return (a + (int(half * 2) << (shift - 1))) >> shift

    rows = rounded(x @ matrix, 12)
    modes = rounded(rounded(matrix @ rows, 17) * 3, 4)
    back = rounded(matrix @ modes, 17)
    expected = rounded(back @ matrix, 17)

    unit = 2.0**-17
    first, other = FoldedSine(matrix * 2.0**-12), FoldedSine(matrix * unit)
    a, b = np.empty((2, size, size))
    fold_rows(x.astype(np.float64), a)
    first.rows(a, b)
    np.testing.assert_array_equal(np.floor(b + half), rows[:, first.order])
    fold_columns(b, half, a)
    other.columns(a, b)
    round_and_scale(b, half, np.full((size, size), 3 / 16), half)
    np.testing.assert_array_equal(b, modes[other.order][:, other.order])
    other.columns_back(b, a)
    unfold_columns(a, half, b)
    np.testing.assert_array_equal(b, back[:, other.order])
    other.rows_back(b, a)
    unfold_rows(a, half, b)
    np.testing.assert_array_equal(b, expected)


@pytest.mark.parametrize("size", [1, 2, 3, 14, 15])
def test_floats_without_rounding(size):
    """Transform and inverse give the input back: the orthonormal DST-I is its own inverse."""
    x = np.random.default_rng(1).normal(size=(size, size)).astype(np.float32)
    matrix = sine_matrix(size).astype(np.float32)
    sine = FoldedSine(matrix)
    a, b = np.empty((2, size, size), np.float32)
    fold_rows(x, a)
    fold_columns(a, None, b)
    sine.rows(b, a)
    sine.columns(a, b)
    np.testing.assert_allclose(b, (matrix @ x @ matrix)[sine.order][:, sine.order], atol=1e-5)
    sine.columns_back(b, a)
    sine.rows_back(a, b)
    unfold_columns(b, None, a)
    unfold_rows(a, None, b)
    np.testing.assert_allclose(b, x, atol=1e-5)


def test_what_is_no_sine_transform_is_told():
    matrix = coefficients(6, 17)
    assert is_foldable(matrix)
    matrix[0, 0] += 1
    assert not is_foldable(matrix)
