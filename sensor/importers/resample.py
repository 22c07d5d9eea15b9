"""Resampling of photographs to a sensor's pixel grid by exact area averaging, padded from the background."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array


def overlaps(source_px: int, target_px: int, scale: float) -> np.ndarray:
    """Share of each target pixel's length that each source pixel covers, float64 (target, source).

    Both grids have the same centre; a target pixel is `scale` source pixels wide. A row sums to 1 where the
    target pixel lies wholly inside the source image, and to less otherwise.
    """
    offset = (source_px - target_px * scale) / 2
    start = offset + np.arange(target_px)[:, None] * scale
    pixel = np.arange(source_px)
    return np.clip(np.minimum(start + scale, pixel + 1) - np.maximum(start, pixel), 0, None) / scale


@dataclass(frozen=True)
class Resampling:
    """Resampling of photographs (height, width) to (target_height, target_width), centred, with the aspect
    ratio kept.

    The photograph fills one axis. Along the other, every frame is padded with the outermost row or column of
    the background, so that the difference from the background is zero there.
    """

    height: int
    width: int
    target_height: int
    target_width: int

    @property
    def scale(self) -> float:
        """Original pixels per resampled pixel, the same along both axes."""
        return max(self.height / self.target_height, self.width / self.target_width)

    def _overlaps(self) -> tuple[np.ndarray, np.ndarray]:
        return (
            overlaps(self.height, self.target_height, self.scale),
            overlaps(self.width, self.target_width, self.scale),
        )

    def valid(self) -> np.ndarray:
        """Mask of the pixels that lie wholly inside the photograph, bool (target_height, target_width)."""
        rows, columns = (weights.sum(axis=1) > 1 - 1e-9 for weights in self._overlaps())
        return rows[:, None] & columns

    def background(self, image: np.ndarray) -> np.ndarray:
        """The background (height, width, C) resampled and padded, float64."""
        padded = []
        for weights in self._overlaps():
            missing = 1 - weights.sum(axis=1)
            half = len(missing) // 2
            weights[:half, 0] += missing[:half]
            weights[half:, -1] += missing[half:]
            padded.append(weights)
        return np.einsum("iv,vuc,ju->ijc", padded[0], image.astype(float), padded[1], optimize=True)

    @cached_property
    def _sparse_overlaps(self) -> tuple[csr_array, csr_array]:
        return tuple(map(csr_array, self._overlaps()))

    def covered(self, image: np.ndarray) -> np.ndarray:
        """An image (height, width, C) resampled, float64, with zero in the padding."""
        rows, columns = self._sparse_overlaps
        high = rows @ image.reshape(self.height, -1).astype(float)
        turned = high.reshape(self.target_height, self.width, -1).swapaxes(0, 1)
        wide = columns @ turned.reshape(self.width, -1)
        return wide.reshape(self.target_width, self.target_height, -1).swapaxes(0, 1)

    def frame(self, image: np.ndarray, background: np.ndarray) -> np.ndarray:
        """A frame (height, width, C) resampled, with `background`'s padding, float64."""
        return self.background(background) + self.covered(image - background.astype(float))

    @cached_property
    def _coverage(self) -> np.ndarray:
        """Share of each target pixel that the photograph covers, (target_height, target_width, 1)."""
        rows, columns = (np.minimum(weights.sum(axis=1), 1) for weights in self._overlaps())
        return (rows[:, None] * columns)[..., None]

    def padding(self, background: np.ndarray) -> np.ndarray:
        """What a `background` that is resampled already adds to `covered` frames, float64.

        The sum is as `frame`, but for rounding, where `background` is the same photograph's, rounded.
        """
        share, beside = self._coverage, background.astype(float)
        for axis in (0, 1):  # of a pixel that is covered in part, the rest is as its neighbour further out
            edge, along = np.moveaxis(beside, axis, 0), np.moveaxis(share, axis, 0).max(axis=(1, 2))
            for k in np.flatnonzero((along > 1e-9) & (along < 1 - 1e-9)):
                outward = k - 1 if k < len(edge) // 2 else k + 1
                if 0 <= outward < len(edge):
                    edge[k] = edge[outward]
        return (1 - share) * beside

    def points_px(self, points: np.ndarray) -> np.ndarray:
        """Convert positions (…, 2), (u, v) in px, from the original to the resampled image.

        In both, integer positions are pixel centres.
        """
        original = np.array([self.width, self.height])
        target = np.array([self.target_width, self.target_height])
        return (points + 0.5 - original / 2) / self.scale + target / 2 - 0.5
