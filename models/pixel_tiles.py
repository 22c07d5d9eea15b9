"""The pixel network over whole frames, tile by tile: what is under way stays in the cache."""

from collections.abc import Sequence

import numpy as np

from .features import coordinate_codes

TILE_PX = 2048


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
        real = tables[0].dtype
        self.tables, self.top, self.floor, self.channels = tables, top, floor, channels
        self.background = background.reshape(-1, channels).T.astype(real)
        self.features = np.ones((channels + 3, height * width), real)
        self.features[channels] = np.tile(coordinate_codes(width), height)
        self.features[channels + 1] = np.repeat(coordinate_codes(height), width)
        self.hidden = [np.ones((len(table) + 1, TILE_PX), real) for table in tables[:-1]]
        self.normal = np.empty((3, height * width), real)

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """A frame (H, W, C) uint8 to the network's outputs (3, H · W), valid until the next call."""
        intensity = frame.reshape(-1, self.channels).T
        np.subtract(intensity, self.background, out=self.features[: self.channels])
        pixels = self.features.shape[1]
        for start in range(0, pixels, TILE_PX):
            tile = slice(start, min(start + TILE_PX, pixels))
            x = self.features[:, tile]
            for table, hidden, top in zip(self.tables, self.hidden, self.top, strict=False):
                into, x = x, hidden[:, : x.shape[1]]
                activation = np.matmul(table, into, out=x[:-1])
                np.clip(activation, 0, top, out=activation)
                if self.floor:
                    np.floor(activation, out=activation)
            np.matmul(self.tables[-1], x, out=self.normal[:, tile])
        return self.normal
