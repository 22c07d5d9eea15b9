"""Slopes of pixels under dots, replaced by those of the nearest skin in the same row, in integers.

A dot swallows the light that the slope is found from. Each half of a dot's width takes the slope beside it:
along a row, the errors of slopes that change evenly under the dot then cancel, and so does their integral.
"""

from dataclasses import dataclass

import numpy as np

from fastac.models.integer.dot_windows import DotWindows


@dataclass(frozen=True, eq=False)
class SlopeBridge:
    """Takes the values of dark pixels from the nearest pixel of the row that is not dark.

    Of two as near it is the left one. Without one within `reach` px a dark pixel keeps its own values.
    """

    windows: DotWindows
    reach: int

    def __post_init__(self):
        if self.reach < 1:
            raise ValueError(f"reach {self.reach}: expected at least 1")

    def dark(self, frames: np.ndarray) -> np.ndarray:
        """Frames (..., H, W, C) uint8 to which pixels are dark, (..., H, W) bool."""
        return self.windows.darkness(frames) > 0

    def columns(self, dark: np.ndarray) -> np.ndarray:
        """Dark pixels (..., H, W) to the column whose values each pixel takes, (..., H, W)."""
        width = dark.shape[-1]
        found = np.broadcast_to(np.arange(width), dark.shape).copy()
        *rows, own = np.nonzero(dark)  # few of all pixels
        nearest, open_ = own.copy(), np.ones(own.shape, bool)
        for distance in range(1, self.reach + 1):
            for step in (-distance, distance):
                column = own + step
                inside = (column >= 0) & (column < width)
                skin = inside & ~dark[*rows, np.clip(column, 0, width - 1)]
                np.copyto(nearest, column, where=open_ & skin)
                open_ &= ~skin
        found[*rows, own] = nearest
        return found

    def __call__(self, values: np.ndarray, dark: np.ndarray) -> np.ndarray:
        """Values (..., H, W, k) and dark pixels (..., H, W) to the bridged values."""
        return np.take_along_axis(values, self.columns(dark)[..., None], axis=-2)
