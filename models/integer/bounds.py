"""Worst-case bounds of the integer Poisson solver, and the word formats that follow from them.

Every value in the solver is a linear function of the slopes plus a constant (the prior or the background)
plus rounding errors. Its largest magnitude is therefore the L1 norm of that linear function times the slope
limit, plus the constant, plus the L1 norm of the rounding errors' way to it. The linear functions are built
from the integer tables themselves, so the bounds hold for the hardware, not for an ideal transform.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fastac.models.integer.laplacian import STENCILS, sine_matrix
from fastac.models.integer.words import Fixed

GUARD_BITS = 4
"""Fractional bits of the data beyond the slopes', where the bound leaves room for them."""


@dataclass(frozen=True)
class Stage:
    """A word of the solver: its worst case in px and the format that holds it."""

    name: str
    bound_px: float
    format: Fixed


def stencil_norms(matrix: np.ndarray, divergence: str) -> tuple[np.ndarray, np.ndarray]:
    """L1 norms over a row or column of slopes: (along the derivative, across it), each (..., N) for matrices
    (..., N, N)."""
    stencil = STENCILS[divergence]
    around = [(0, 0)] * (matrix.ndim - 1) + [(stencil.span, stencil.span)]
    along = stencil.differences(np.pad(matrix, around), matrix.ndim - 1)
    return stencil.scale * np.abs(along).sum(axis=-1), np.abs(matrix).sum(axis=-1)


def green_norm(matrix: np.ndarray, reciprocal: np.ndarray, divergence: str) -> float:
    """max over pixels of the L1 norm of the map from slopes to that pixel's solution.

    matrix : the DST-I's, symmetric and its rows even and odd about the middle in turn
    The square's symmetries leave one octant of pixels to try: mirrored, a stencil only changes its sign.
    Kept for the next solver of the same tables, as a sweep has many.
    """
    tables = (np.asarray(table, np.float64).tobytes() for table in (matrix, reciprocal))
    return _green_norm(len(matrix), *tables, divergence)


@lru_cache(maxsize=16)
def _green_norm(size: int, of_matrix: bytes, of_reciprocal: bytes, divergence: str) -> float:
    matrix, reciprocal = (np.frombuffer(table).reshape(size, size) for table in (of_matrix, of_reciprocal))
    half, stencil, worst = (size + 1) // 2, STENCILS[divergence], 0.0
    # Every other mode is even about the middle, the others odd: half the columns' products give the rest.
    parities = slice(0, None, 2), slice(1, None, 2)
    tables = [np.ascontiguousarray(matrix[parity, :half]) for parity in parities]
    even, odd = np.empty((2, size, half))
    green = np.zeros((size + 4, size + 4))
    left, right = green[2:-2, 2 : 2 + half], green[2:-2, -3 : -3 - half : -1]
    for i in range(half):
        rows = matrix @ (matrix[i][:, None] * reciprocal)
        ways = [np.ascontiguousarray(rows[:, parity]) for parity in parities]
        # A pixel at a time, whose Green's function fits the processor's cache.
        for j in range(i, half):
            for parity, way, table, part in zip(parities, ways, tables, (even, odd), strict=True):
                np.matmul(way, table * matrix[j, parity][:, None], out=part)
            np.subtract(even, odd, out=right)
            np.add(even, odd, out=left)
            norm = 0.0
            for axis in (0, 1):
                change = stencil.differences(green, axis)
                norm += float(np.abs(change, out=change).sum())
            worst = max(worst, stencil.scale * norm)
    return worst


def between_rows(matrix: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Σ over m of matrix[i, m] · weights[m, n] · matrix[m, k]: an operator from rows k to rows i for each n,
    (n, i, k)."""
    return (matrix * weights.T[:, None, :]) @ matrix


def coefficients(size: int, fraction: int) -> np.ndarray:
    """The DST-I's integers, round(2**fraction · sine_matrix)."""
    return np.rint(sine_matrix(size) * 2.0**fraction).astype(np.int64)
