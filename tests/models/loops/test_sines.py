"""Folded transforms against products with the full matrix, on integers."""

import numpy as np
import pytest

from fastac.models.integer.bounds import coefficients
from fastac.models.integer.laplacian import sine_matrix
from fastac.models.loops.poisson import COLUMNS, PIXELS, ROWS, divide_modes
from fastac.models.loops.sines import BAND, FoldedSine, fold_rows, is_foldable, rows_product, unfold_rows
from fastac.models.loops.tasks import new_board

SIZES = pytest.mark.parametrize("size", [1, 2, 3, 14, 15, 33])


def to_modes(sine: FoldedSine, x: np.ndarray) -> np.ndarray:
    """Rows x (N, N) to their modes, band by band, in the memory of all of them."""
    modes, folded = sine.memory(), np.zeros((BAND, sine.memory().shape[1]), x.dtype)
    for first in range(0, sine.size, BAND):
        fold_rows(x[first : first + BAND].reshape(-1), sine.size, sine.half, folded)
        rows_product(folded, sine.rows, modes[first : first + BAND])
    return modes


def from_modes(sine: FoldedSine, modes: np.ndarray, half_unit: float | None) -> np.ndarray:
    """The inverse, with a rounding."""
    found, partial = (
        np.empty((sine.size, sine.size), modes.dtype),
        np.zeros((BAND, modes.shape[1]), modes.dtype),
    )
    for first in range(0, sine.size, BAND):
        rows_product(modes[first : first + BAND], sine.rows_back, partial)
        unfold_rows(partial, sine.half, half_unit, sine.size, found[first : first + BAND].reshape(-1))
    return found


def stored(sine: FoldedSine, modes: np.ndarray) -> np.ndarray:
    """The N modes of each of N rows, in their order."""
    found = np.empty((sine.size, sine.size), modes.dtype)
    found[:, 0::2] = modes[: sine.size, : sine.first]
    found[:, 1::2] = modes[: sine.size, sine.half : sine.half + sine.size - sine.first]
    return found


def divided(
    sine: FoldedSine, other: FoldedSine, modes: np.ndarray, factors: np.ndarray, halves: tuple
) -> None:
    """The columns' transform, factors (N, N) and inverse transform, in place, by a team of one."""
    board, blocks = new_board(1, 0, 0, sine.blocks, 0), sine.in_blocks(sine.by_modes(factors.T).T)
    divide_modes(board, 0, other.columns, other.columns_back, blocks, halves, sine.size, modes)
    assert (board[[PIXELS, ROWS], 1, 0] == 0).all()
    assert board[COLUMNS, 1, 0] == sine.blocks


@SIZES
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
    found = to_modes(first, x.astype(np.float64))
    np.testing.assert_array_equal(np.floor(stored(first, found) + half), rows)
    divided(first, other, found, np.full((size, size), 3 / 16), (half,) * 4)
    np.testing.assert_array_equal(stored(first, found), back)
    np.testing.assert_array_equal(from_modes(other, found, half), expected)


@SIZES
def test_floats_without_rounding(size):
    """Transform and inverse give the input back: the orthonormal DST-I is its own inverse."""
    rng = np.random.default_rng(1)
    x, factors = rng.normal(size=(2, size, size)).astype(np.float32)
    matrix = sine_matrix(size).astype(np.float32)
    sine = FoldedSine(matrix)
    modes = to_modes(sine, x)
    np.testing.assert_allclose(stored(sine, modes), x @ matrix, atol=1e-5)
    np.testing.assert_allclose(from_modes(sine, modes, None), x, atol=1e-5)
    divided(sine, sine, modes, factors, (None,) * 4)
    expected = matrix @ (matrix @ x @ matrix * factors) @ matrix
    np.testing.assert_allclose(from_modes(sine, modes, None), expected, atol=1e-4)


def test_what_is_no_sine_transform_is_told():
    matrix = coefficients(6, 17)
    assert is_foldable(matrix)
    matrix[0, 0] += 1
    assert not is_foldable(matrix)
