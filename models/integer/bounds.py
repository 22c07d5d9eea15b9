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
    """L1 norms over a row or column of slopes: (along the derivative, across it), each (N,)."""
    kernel = STENCILS[divergence].kernel
    along = np.abs(np.array([np.convolve(row, kernel) for row in matrix])).sum(axis=1)
    return along, np.abs(matrix).sum(axis=1)


def green_norm(matrix: np.ndarray, reciprocal: np.ndarray, divergence: str) -> float:
    """max over pixels of the L1 norm of the map from slopes to that pixel's solution.

    The square's symmetries leave one octant of pixels to try: mirrored, a stencil only changes its sign.
    Kept for the next solver of the same tables, as a sweep has many.
    """
    tables = (np.asarray(table, np.float64).tobytes() for table in (matrix, reciprocal))
    return _green_norm(len(matrix), *tables, divergence)


@lru_cache(maxsize=16)
def _green_norm(size: int, of_matrix: bytes, of_reciprocal: bytes, divergence: str) -> float:
    matrix, reciprocal = (np.frombuffer(table).reshape(size, size) for table in (of_matrix, of_reciprocal))
    half, stencil = (size + 1) // 2, STENCILS[divergence]
    worst = 0.0
    for i in range(half):
        rows = matrix @ (matrix[i][:, None] * reciprocal)
        green = (rows * matrix[i:half, None, :]) @ matrix
        padded = np.pad(green, ((0, 0), (2, 2), (2, 2)))
        norms = [stencil.scale * np.abs(stencil.differences(padded, axis)) for axis in (1, 2)]
        worst = max(worst, float(sum(x.sum(axis=(1, 2)) for x in norms).max()))
    return worst


def coefficients(size: int, fraction: int) -> np.ndarray:
    """The DST-I's integers, round(2**fraction · sine_matrix)."""
    return np.rint(sine_matrix(size) * 2.0**fraction).astype(np.int64)
