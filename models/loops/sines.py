"""The DST-I folded: half the products, for its sines are even or odd about the middle.

S[k, N − 1 − n] = (−1)**k S[k, n]. So even modes k see only x[n] + x[N − 1 − n], odd ones only the difference:
two products of half the size. On the way back even modes give one sum, odd ones another; the two halves of
the row are their sum and their difference. A folded axis holds sums, then differences; its modes are the even
ones, then the odd ones. With integers all of that is exact, within the bounds of the whole product.
"""

from functools import cached_property

import numpy as np
from numba import njit

_compiled = njit(nogil=True, cache=True)


def is_foldable(matrix: np.ndarray) -> bool:
    """Whether the rows of a table (N, N) are even and odd about the middle in turn, exactly."""
    sign = np.where(np.arange(len(matrix)) % 2, -1, 1)
    return np.array_equal(matrix[:, ::-1], matrix * sign[:, None])


class FoldedSine:
    """A symmetric DST-I's table (N, N), of which only a quarter is read; see `is_foldable`."""

    def __init__(self, matrix: np.ndarray):
        size = len(matrix)
        self.first = size - size // 2
        """How many even modes there are, and sums."""
        self.even = np.ascontiguousarray(matrix[: self.first, 0::2])
        self.odd = np.ascontiguousarray(matrix[: size - self.first, 1::2])
        self.order = np.r_[0:size:2, 1:size:2]
        """The modes as they lie in memory."""

    @cached_property
    def _back(self) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(self.even.T), np.ascontiguousarray(self.odd.T)

    def rows(self, x: np.ndarray, out: np.ndarray) -> None:
        """Folded rows (rows, N) to their modes."""
        m = self.first
        np.matmul(x[:, :m], self.even, out=out[:, :m])
        np.matmul(x[:, m:], self.odd, out=out[:, m:])

    def rows_back(self, x: np.ndarray, out: np.ndarray) -> None:
        """Modes (rows, N) to the even and the odd ones' sums."""
        m, (even, odd) = self.first, self._back
        np.matmul(x[:, :m], even, out=out[:, :m])
        np.matmul(x[:, m:], odd, out=out[:, m:])

    def columns(self, x: np.ndarray, out: np.ndarray) -> None:
        """`rows` of the columns."""
        m, (even, odd) = self.first, self._back
        np.matmul(even, x[:m], out=out[:m])
        np.matmul(odd, x[m:], out=out[m:])

    def columns_back(self, x: np.ndarray, out: np.ndarray) -> None:
        """`rows_back` of the columns."""
        m = self.first
        np.matmul(self.even, x[:m], out=out[:m])
        np.matmul(self.odd, x[m:], out=out[m:])


@_compiled
def _rounded(value, half_unit):
    """floor(value + half_unit); the value itself where that is None."""
    return value if half_unit is None else np.floor(value + half_unit)


@_compiled
def fold_rows(x, out):
    """Each row of x (rows, N) folded."""
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
    """The columns of x (N, columns), `_rounded`, folded."""
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
    """The columns whose even and odd modes' sums x (N, columns) are, `_rounded`."""
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
    """The rows whose even and odd modes' sums x (rows, N) are, `_rounded`."""
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
    """In place, x times scale (N, N), `_rounded` before and after it."""
    for i in range(len(x)):
        row, factor = x[i], scale[i]
        for j in range(len(row)):
            row[j] = _rounded(_rounded(row[j], half_unit) * factor[j], half_scaled)
