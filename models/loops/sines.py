"""The folded DST-I: a discrete sine transform with half the products, by its even and odd symmetry.

S[k, N − 1 − n] = (−1)**k S[k, n], so that even modes k depend only on the sums x[n] + x[N − 1 − n] and odd
ones only on the differences: two matrix products of half the size. In the inverse transform the even modes
give one partial result and the odd ones another; their sum and their difference are the two halves of the
row. A folded axis holds the sums, then the differences; its transform the even modes, then the odd ones. With
integers all of this is exact, within the bounds of the full product.
"""

from functools import cached_property

import numpy as np
from numba import njit

_compiled = njit(nogil=True, cache=True)


def is_foldable(matrix: np.ndarray) -> bool:
    """Whether the rows of a table (N, N) are alternately even and odd about the middle, exactly."""
    sign = np.where(np.arange(len(matrix)) % 2, -1, 1)
    return np.array_equal(matrix[:, ::-1], matrix * sign[:, None])


class FoldedSine:
    """The two half-size tables of a symmetric DST-I table (N, N); see `is_foldable`."""

    def __init__(self, matrix: np.ndarray):
        size = len(matrix)
        self.first = size - size // 2
        """Number of even modes, and of sums."""
        self.even = np.ascontiguousarray(matrix[: self.first, 0::2])
        self.odd = np.ascontiguousarray(matrix[: size - self.first, 1::2])
        self.order = np.r_[0:size:2, 1:size:2]
        """(N,) modes in the order in which they are stored: even ones, then odd ones."""

    @cached_property
    def _back(self) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(self.even.T), np.ascontiguousarray(self.odd.T)

    def rows(self, x: np.ndarray, out: np.ndarray) -> None:
        """Transform folded rows x (rows, N) into modes, written to `out`."""
        m = self.first
        np.matmul(x[:, :m], self.even, out=out[:, :m])
        np.matmul(x[:, m:], self.odd, out=out[:, m:])

    def rows_back(self, x: np.ndarray, out: np.ndarray) -> None:
        """Inverse transform of modes x (rows, N): the even and the odd modes' partial results, for
        `unfold_rows`."""
        m, (even, odd) = self.first, self._back
        np.matmul(x[:, :m], even, out=out[:, :m])
        np.matmul(x[:, m:], odd, out=out[:, m:])

    def columns(self, x: np.ndarray, out: np.ndarray) -> None:
        """As `rows`, along the columns."""
        m, (even, odd) = self.first, self._back
        np.matmul(even, x[:m], out=out[:m])
        np.matmul(odd, x[m:], out=out[m:])

    def columns_back(self, x: np.ndarray, out: np.ndarray) -> None:
        """As `rows_back`, along the columns."""
        m = self.first
        np.matmul(self.even, x[:m], out=out[:m])
        np.matmul(self.odd, x[m:], out=out[m:])


@_compiled
def _rounded(value, half_unit):
    """Round to an integer, floor(value + half_unit); without rounding where half_unit is None."""
    return value if half_unit is None else np.floor(value + half_unit)


@_compiled
def fold_rows(x, out):
    """Fold each row of x (rows, N) into sums and differences."""
    size = x.shape[1]
    half = size // 2
    for i in range(len(x)):
        row, mirrored = x[i], x[i, ::-1]
        sums, differences = out[i], out[i, size - half :]
        for j in range(half):
            sums[j] = row[j] + mirrored[j]
            differences[j] = row[j] - mirrored[j]
        if size % 2:
            sums[half] = row[half]


@_compiled
def fold_columns(x, half_unit, out):
    """Round x (N, columns) by `_rounded`, and fold each column into sums and differences."""
    size = len(x)
    half = size // 2
    for i in range(half):
        row, mirrored, sums, differences = x[i], x[size - 1 - i], out[i], out[size - half + i]
        for j in range(len(row)):
            a, b = _rounded(row[j], half_unit), _rounded(mirrored[j], half_unit)
            sums[j] = a + b
            differences[j] = a - b
    if size % 2:
        row, sums = x[half], out[half]
        for j in range(len(row)):
            sums[j] = _rounded(row[j], half_unit)


@_compiled
def unfold_columns(x, half_unit, out):
    """Unfold the columns of x (N, columns), the results of `columns_back`, and round by `_rounded`."""
    size = len(x)
    half = size // 2
    for i in range(half):
        even, odd, row, mirrored = x[i], x[size - half + i], out[i], out[size - 1 - i]
        for j in range(len(row)):
            row[j] = _rounded(even[j] + odd[j], half_unit)
            mirrored[j] = _rounded(even[j] - odd[j], half_unit)
    if size % 2:
        even, row = x[half], out[half]
        for j in range(len(row)):
            row[j] = _rounded(even[j], half_unit)


@_compiled
def unfold_rows(x, half_unit, out):
    """Unfold the rows of x (rows, N), the results of `rows_back`, and round by `_rounded`."""
    size = x.shape[1]
    half = size // 2
    for i in range(len(x)):
        even, odd, row, mirrored = x[i], x[i, size - half :], out[i], out[i, ::-1]
        for j in range(half):
            row[j] = _rounded(even[j] + odd[j], half_unit)
            mirrored[j] = _rounded(even[j] - odd[j], half_unit)
        if size % 2:
            row[half] = _rounded(even[half], half_unit)


@_compiled
def round_and_scale(x, half_unit, scale, half_scaled):
    """Multiply x by scale, both (N, N), in place, and round by `_rounded` before and after."""
    for i in range(len(x)):
        row, factor = x[i], scale[i]
        for j in range(len(row)):
            row[j] = _rounded(_rounded(row[j], half_unit) * factor[j], half_scaled)
