"""The folded DST-I: a discrete sine transform with half the products, by its even and odd symmetry.

S[k, N − 1 − n] = (−1)**k S[k, n], so that even modes k depend only on the sums x[n] + x[N − 1 − n] and odd
ones only on the differences: two matrix products of half the size. In the inverse transform the even modes
give one partial result and the odd ones another; their sum and their difference are the two halves of the
row. A folded axis holds the sums, then the differences; its transform the even modes, then the odd ones. Each
half is padded to whole tiles (loops/matrix_tile.py) with what the tables multiply by zero. With integers all
of this is exact, within the bounds of the full product.

Rows are transformed in bands of BAND rows, and columns in blocks as wide as a tile, so that threads can share
them and each stays in the processor's cache.
"""

import numpy as np

from fastac.models.loops.matrix_tile import ROWS, product_tile, tile_columns
from fastac.models.loops.memory import aligned
from fastac.store.compiled_loops import compiled

_compiled = compiled()

BAND = 2 * ROWS
"""Rows of a band."""
ASIDE = 8
"""Numbers by which rows in memory are longer than both halves: at powers of two they would share cache
lines."""


def is_foldable(matrix: np.ndarray) -> bool:
    """Whether the rows of a table (N, N) are alternately even and odd about the middle, exactly."""
    sign = np.where(np.arange(len(matrix)) % 2, -1, 1)
    return np.array_equal(matrix[:, ::-1], matrix * sign[:, None])


class FoldedSine:
    """The two half-size tables of a symmetric DST-I table (N, N), in the layout of tiles; see `is_foldable`.

    rows, rows_back : for `rows_product`, transform and inverse, (2, panels, K, tile columns)
    columns, columns_back : for `columns_product`, (2, tiles, K, ROWS)
    """

    def __init__(self, matrix: np.ndarray):
        self.size = size = len(matrix)
        self.first = size - size // 2
        """K: number of even modes, and of sums."""
        even, odd = matrix[: self.first, 0::2], matrix[: size - self.first, 1::2]
        self.columns_wide = tile_columns(matrix.itemsize)
        """Columns of a block."""
        self.half = -(-self.first // self.columns_wide) * self.columns_wide
        """Padded width of each half."""
        self.rows, self.rows_back = self._panels(even, odd), self._panels(even.T, odd.T)
        self.columns, self.columns_back = self._tiles(even.T, odd.T), self._tiles(even, odd)

    def _panels(self, *halves: np.ndarray) -> np.ndarray:
        found = np.zeros((2, self.first, self.half), halves[0].dtype)
        for place, table in zip(found, halves, strict=True):
            place[: table.shape[0], : table.shape[1]] = table
        panels = found.reshape(2, self.first, -1, self.columns_wide)
        return aligned(panels.transpose(0, 2, 1, 3))

    def _tiles(self, *halves: np.ndarray) -> np.ndarray:
        found = np.zeros((2, self.half, self.first), halves[0].dtype)
        for place, table in zip(found, halves, strict=True):
            place[: table.shape[0], : table.shape[1]] = table
        return aligned(found.reshape(2, -1, ROWS, self.first).transpose(0, 1, 3, 2))

    @property
    def bands(self) -> int:
        """Of rows."""
        return -(-self.size // BAND)

    @property
    def blocks(self) -> int:
        """Of columns."""
        return 2 * self.half // self.columns_wide

    def memory(self) -> np.ndarray:
        """Zeros for the modes of all rows, in whole bands, (rows, `half` · 2 + ASIDE)."""
        return aligned(np.zeros((self.bands * BAND, 2 * self.half + ASIDE), self.rows.dtype))

    def by_modes(self, table: np.ndarray) -> np.ndarray:
        """A table whose last axis are N modes, (..., N), with them as they are stored, (..., 2 halves); 0
        between and beyond them."""
        found = np.zeros((*table.shape[:-1], 2 * self.half), self.rows.dtype)
        found[..., : self.first] = table[..., 0::2]
        found[..., self.half : self.half + self.size - self.first] = table[..., 1::2]
        return found

    def in_blocks(self, table: np.ndarray) -> np.ndarray:
        """A table (rows, N modes) by blocks of columns, (blocks, rows, tile columns)."""
        blocks = self.by_modes(table).reshape(len(table), -1, self.columns_wide)
        return aligned(blocks.transpose(1, 0, 2))


@_compiled
def rows_product(x, panels, out):
    """Products of both halves of each row, x (rows, 2 halves or more) to `out` of the same shape.

    rows : a multiple of ROWS; panels : of FoldedSine
    """
    _, count, depth, wide = panels.shape
    real, size = panels[0, 0, 0, 0], panels.itemsize
    row, out_row = x.strides[0] // size, out.strides[0] // size
    for half in range(2):
        for k in range(count):
            panel, left = panels[half, k].ctypes.data, half * count * wide
            for r in range(0, len(x), ROWS):
                given = x.ctypes.data + (r * row + left) * size
                found = out.ctypes.data + (r * out_row + left + k * wide) * size
                product_tile(real, given, row, 1, panel, wide, depth, found, out_row)


@_compiled
def columns_product(tiles, x, out):
    """Products of both halves of each column of a block, x (2 halves, tile columns) to `out` of the same
    shape.

    tiles : of FoldedSine
    """
    _, count, depth, rows = tiles.shape
    real, size, wide = tiles[0, 0, 0, 0], tiles.itemsize, x.shape[1]
    for half in range(2):
        first = half * count * rows
        given = x.ctypes.data + first * wide * size
        for k in range(count):
            found = out.ctypes.data + (first + k * rows) * wide * size
            product_tile(real, tiles[half, k].ctypes.data, 1, rows, given, wide, depth, found, wide)


@_compiled
def _rounded(value, half_unit):
    """Round to an integer, floor(value + half_unit); without rounding where half_unit is None."""
    return value if half_unit is None else np.floor(value + half_unit)


@_compiled
def fold_rows(x, size, half, out):
    """Fold rows x (rows · size,) into sums, and differences that begin at `half`, each row in a row of
    `out`."""
    middle = size // 2
    for i in range(len(x) // size):
        row = x[i * size : (i + 1) * size]
        mirrored, sums, differences = row[::-1], out[i], out[i, half:]
        for j in range(middle):
            sums[j] = row[j] + mirrored[j]
            differences[j] = row[j] - mirrored[j]
        if size % 2:
            sums[middle] = row[middle]


@_compiled
def unfold_rows(x, half, half_unit, size, out):
    """Unfold the rows of x, results of an inverse `rows_product`, into `out` (rows · size,), and round by
    `_rounded`."""
    middle = size // 2
    for i in range(len(out) // size):
        even, odd, row = x[i], x[i, half:], out[i * size : (i + 1) * size]
        mirrored = row[::-1]
        for j in range(middle):
            row[j] = _rounded(even[j] + odd[j], half_unit)
            mirrored[j] = _rounded(even[j] - odd[j], half_unit)
        if size % 2:
            row[middle] = _rounded(even[middle], half_unit)


@_compiled
def fold_columns(x, first, size, half_unit, out):
    """Round a block of columns of x, `size` rows from column `first` on, by `_rounded`, and fold each column
    into sums and differences, `out` (2 halves, columns)."""
    half, count = len(out) // 2, out.shape[1]
    middle = size // 2
    for i in range(middle):
        row, mirrored = x[i, first : first + count], x[size - 1 - i, first : first + count]
        sums, differences = out[i], out[half + i]
        for j in range(count):
            a, b = _rounded(row[j], half_unit), _rounded(mirrored[j], half_unit)
            sums[j] = a + b
            differences[j] = a - b
    if size % 2:
        row, sums = x[middle, first : first + count], out[middle]
        for j in range(count):
            sums[j] = _rounded(row[j], half_unit)


@_compiled
def unfold_columns(x, half_unit, out, first, size):
    """Unfold the results of an inverse `columns_product`, x (2 halves, columns), into `size` rows of `out`
    from column `first` on, and round by `_rounded`."""
    half, count = len(x) // 2, x.shape[1]
    middle = size // 2
    for i in range(middle):
        even, odd = x[i], x[half + i]
        row, mirrored = out[i, first : first + count], out[size - 1 - i, first : first + count]
        for j in range(count):
            row[j] = _rounded(even[j] + odd[j], half_unit)
            mirrored[j] = _rounded(even[j] - odd[j], half_unit)
    if size % 2:
        even, row = x[middle], out[middle, first : first + count]
        for j in range(count):
            row[j] = _rounded(even[j], half_unit)


@_compiled
def round_and_scale(x, half_unit, scale, half_scaled):
    """Multiply x by scale, of the same shape, in place, and round by `_rounded` before and after."""
    for i in range(len(x)):
        row, factor = x[i], scale[i]
        for j in range(len(row)):
            row[j] = _rounded(_rounded(row[j], half_unit) * factor[j], half_scaled)
