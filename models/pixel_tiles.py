"""The pixel network over whole frames, tile by tile: what is under way stays in the cache.

In torch, whose clip of a tile takes half of NumPy's time; on one thread, for `over_frames` has one for each
core.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import torch

from .features import coordinate_codes

TILE_PX = 4096


def interleave(planes: np.ndarray, out: np.ndarray) -> None:
    """Planes (C, H · W) into `out` (H, W, C), in its element type."""
    cv2.merge(planes.astype(out.dtype, copy=False).reshape(-1, *out.shape[:2]), out)


class PixelTiles:
    """The scratch memory of one thread, called on one frame after another.

    tables : of each layer (neurons, inputs + 1), the bias last, of the element type to compute in
    top : activations are clipped to 0 … top
    floor : whether they are rounded down to integers
    background : (H, W, C) uint8

    Pixels are columns, so that bias and coordinates are rows that never change.
    """

    def __init__(
        self, tables: Sequence[np.ndarray], background: np.ndarray, *, top: Sequence[float], floor: bool
    ):
        height, width, channels = background.shape
        pixels, real = height * width, tables[0].dtype
        self.top, self.floor, self.channels = top, floor, channels
        self.background = background.astype(np.int16)
        self.change = np.empty((channels, height, width), np.int16)
        self.features = np.ones((channels + 3, pixels), real)
        self.features[channels] = np.tile(coordinate_codes(width), height)
        self.features[channels + 1] = np.repeat(coordinate_codes(height), width)
        self.normal = np.empty((3, pixels), real)
        self.tables = [torch.from_numpy(np.ascontiguousarray(table)) for table in tables]
        hidden = [np.ones((len(table) + 1, min(TILE_PX, pixels)), real) for table in tables[:-1]]
        whole = [torch.from_numpy(array) for array in (self.features, self.normal, *hidden)]
        self.tiles = []
        for start in range(0, pixels, TILE_PX):
            tile = slice(start, min(start + TILE_PX, pixels))
            first = slice(0, tile.stop - start)
            features, normal, *words = whole
            self.tiles.append((features[:, tile], [word[:, first] for word in words], normal[:, tile]))

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """A frame (H, W, C) uint8 to the network's outputs (3, H · W), valid until the next call."""
        cv2.split(frame.astype(np.int16) - self.background, [*self.change])
        self.features[: self.channels] = self.change.reshape(self.channels, -1)
        for x, hidden, normal in self.tiles:
            for table, words, top in zip(self.tables, hidden, self.top, strict=False):
                activation = torch.mm(table, x, out=words[:-1]).clamp_(0, top)
                if self.floor:
                    activation.floor_()
                x = words
            torch.mm(self.tables[-1], x, out=normal)
        return self.normal
