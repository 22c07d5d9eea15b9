"""Folded transforms against the whole matrix's product, on integers."""

import numpy as np
import pytest

from models.bounds import coefficients
from models.sine_fold import (
    FoldedSine,
    fold_rows,
    round_and_fold_columns,
    round_and_scale,
    unfold_columns_and_round,
    unfold_rows_and_round,
)


@pytest.mark.parametrize("size", [1, 2, 3, 14, 15])
@pytest.mark.parametrize("half", [0.0, 0.5])
@pytest.mark.parametrize("extreme", [0, 1 << 25, None])
def test_equals_the_whole_product(size, half, extreme):
    """All zero, alternating extremes, and anything between, rounded to the nearest and down."""
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
    round_and_fold_columns(b, half, a)
    other.columns(a, b)
    round_and_scale(b, half, np.full((size, size), 3 / 16), half)
    np.testing.assert_array_equal(b, modes[other.order][:, other.order])
    other.columns_back(b, a)
    unfold_columns_and_round(a, half, b)
    np.testing.assert_array_equal(b, back[:, other.order])
    other.rows_back(b, a)
    unfold_rows_and_round(a, half, b)
    np.testing.assert_array_equal(b, expected)


def test_refuses_what_is_no_sine_transform():
    matrix = coefficients(6, 17)
    matrix[0, 0] += 1
    with pytest.raises(ValueError, match=r"matrix \(6, 6\): expected rows even or odd about the middle"):
        FoldedSine(matrix)
