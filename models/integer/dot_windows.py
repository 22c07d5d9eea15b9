"""Where dark dots are, in integers: each pixel's darkness, and its moments in windows all over the image.

The darkness of a pixel is what its channels' sum lacks from a threshold, a share of the skin's brightness at
rest. Lights opposite each other make the sum nearly independent of the skin's slope, so no brightness has to
be estimated in the frame itself. A window's sum of darkness and its first moments give the centre of the
dark matter in it (models/integer/dot_follower.py), as image moments do (Hu, "Visual pattern recognition by
moment invariants", IRE Transactions on Information Theory 8, 1962).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.words import signed_width
from fastac.scenes.checks import DOT_BLOCK_PX

CELL = 2
"""Side of a cell in px: windows begin and end at multiples of it."""
BLOCK = DOT_BLOCK_PX
"""Side in px of the squares in which the threshold is constant."""


@dataclass(frozen=True, eq=False)
class DotWindows:
    """Sum and first moments of the darkness in square windows of 2 · `half` + 1 cells, around each cell.

    Only windows that lie wholly inside the image exist: window (r, c) is around cell (r + half, c + half).
    Moments are about the window's centre, in half pixels, u to the right and v downwards.
    """

    threshold: np.ndarray  # (H / BLOCK, W / BLOCK), in sums over the channels
    channels: int
    half: int
    loadable: bool = False
    """Whether the hardware may be loaded with any other thresholds."""

    def __post_init__(self):
        if self.half < 1 or min(self.shape) < 1:
            raise ValueError(
                f"half {self.half}, threshold {self.threshold.shape}: expected windows of 3 cells or more"
                " that fit into the image"
            )
        if self.threshold.min() < 0 or self.threshold.max() > self.brightest:
            raise ValueError(
                f"threshold {self.threshold.min()} to {self.threshold.max()}: expected 0 to {self.brightest}"
            )

    @property
    def brightest(self) -> int:
        """The largest sum of a pixel's channels."""
        return 255 * self.channels

    @property
    def darkest(self) -> int:
        """The largest darkness of a pixel."""
        return self.brightest if self.loadable else int(self.threshold.max())

    @property
    def darkness_width(self) -> int:
        """Bits of a pixel's darkness, unsigned."""
        return self.darkest.bit_length()

    @property
    def image(self) -> tuple[int, int]:
        """H and W in px."""
        rows, columns = self.threshold.shape
        return rows * BLOCK, columns * BLOCK

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of windows."""
        return tuple(side // CELL - 2 * self.half for side in self.image)

    @cached_property
    def largest(self) -> np.ndarray:
        """The largest darkness of each pixel, (H, W)."""
        threshold = np.full_like(self.threshold, self.darkest) if self.loadable else self.threshold
        return _of_pixels(threshold)

    @cached_property
    def mass_bound(self) -> int:
        """The largest sum of a window."""
        return int(_box(self._cells(self.largest), self.half).max())

    @cached_property
    def moment_bound(self) -> int:
        """The largest magnitude of a window's moment: all darkness on one side of its centre."""
        side = 2 * (2 * self.half + 1)
        distance = 2 * np.arange(side) - (side - 1)
        largest = np.lib.stride_tricks.sliding_window_view(self.largest, (side, side))[::CELL, ::CELL]
        one_side = np.maximum(distance, 0)
        across = np.einsum("rcij,j->rc", largest, one_side), np.einsum("rcij,i->rc", largest, one_side)
        back = (
            np.einsum("rcij,j->rc", largest, one_side[::-1]),
            np.einsum("rcij,i->rc", largest, one_side[::-1]),
        )
        return int(np.max([across, back]))

    @property
    def mass_width(self) -> int:
        """Bits of a window's sum, unsigned."""
        return self.mass_bound.bit_length()

    @property
    def moment_width(self) -> int:
        return signed_width(self.moment_bound)

    def darkness(self, frames: np.ndarray) -> np.ndarray:
        """Frames (..., H, W, C) uint8 to the darkness of each pixel, (..., H, W) int64."""
        total = np.einsum("...c->...", frames, dtype=np.int64)  # faster than sum over so short an axis
        return np.maximum(_of_pixels(self.threshold) - total, 0)

    @staticmethod
    def _cells(values: np.ndarray) -> np.ndarray:
        """Sums over the pixels of each cell, (..., H, W) to (..., H / CELL, W / CELL)."""
        *rest, height, width = values.shape
        return values.reshape(*rest, height // CELL, CELL, width // CELL, CELL).sum(axis=(-3, -1))

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        """Frames (..., H, W, C) uint8 to windows (..., rows, columns, 3) int64: sum, moment of u, of v."""
        return self.of_darkness(self.darkness(frames))

    def of_darkness(self, dark: np.ndarray) -> np.ndarray:
        """Darkness (..., H, W) to windows (..., rows, columns, 3)."""
        mass = self._cells(dark)
        sides = 2 * np.arange(CELL) - (CELL - 1)
        height, width = self.image
        moments = (
            self._cells(dark * np.tile(sides, width // CELL)),
            self._cells(dark * np.tile(sides, height // CELL)[:, None]),
        )
        # About the image's first cell; a window's moment is that about its own centre.
        columns, rows = (2 * CELL * np.arange(n) for n in mass.shape[:-3:-1])
        total = _box(mass, self.half)
        inner = [slice(self.half, self.half + n) for n in self.shape]
        moved = (moments[0] + columns * mass, moments[1] + rows[:, None] * mass)
        u = _box(moved[0], self.half) - columns[inner[1]] * total
        v = _box(moved[1], self.half) - rows[inner[0], None] * total
        return np.stack([total, u, v], axis=-1)


def _of_pixels(blocks: np.ndarray) -> np.ndarray:
    """Values of blocks as those of their pixels, (H / BLOCK, W / BLOCK) to (H, W) int64."""
    return np.kron(blocks.astype(np.int64), np.ones((BLOCK, BLOCK), np.int64))


def _box(values: np.ndarray, half: int) -> np.ndarray:
    """Sums over squares of 2 · half + 1 values, (..., rows, columns) to (..., rows − 2·half, columns − …)."""
    for axis in (-2, -1):
        values = np.lib.stride_tricks.sliding_window_view(values, 2 * half + 1, axis=axis).sum(axis=-1)
    return values
