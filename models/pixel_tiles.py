"""The pixel network over whole frames: its tables as the compiled loops read them, and their memory."""

from collections.abc import Sequence

import cv2
import numpy as np

from .features import coordinate_codes
from .pixel_kernel import forward, packed


class PixelTiles:
    """The scratch memory of one thread, called on one frame after another.

    tables : of each layer (neurons, inputs + 1), the bias last: the hidden layers' of one element type, the
        last one's of its own; computed in those types
    background : (H, W, C) uint8
    requantise : of each hidden layer its multipliers · 2**−shift (neurons,) and the largest activation, as
        `integer.Requantisation`; None: activations are rectified only
    """

    def __init__(
        self,
        tables: Sequence[np.ndarray],
        background: np.ndarray,
        *,
        requantise: Sequence[tuple[np.ndarray, int]] | None = None,
    ):
        height, width, channels = background.shape
        *hidden, last = tables
        scales, tops = zip(*requantise or [(None, 0)] * len(hidden), strict=True)
        self.requantised = requantise is not None
        self.tops = np.array(tops, tables[0].dtype)
        self.hidden = tuple(packed(*layer) for layer in zip(hidden, scales, strict=True))
        self.last = packed(last)
        self.planes = np.empty((channels, height, width), np.uint8)
        rest = np.empty((channels + 2, height, width), np.float32)
        rest[:channels] = np.moveaxis(background, -1, 0)
        rest[channels] = coordinate_codes(width)
        rest[channels + 1] = coordinate_codes(height)[:, None]
        self.rest = rest.reshape(channels + 2, -1)
        self.normal = np.empty((len(last), height * width), last.dtype)

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """A frame (H, W, C) uint8 to the network's outputs (3, H · W), valid until the next call."""
        cv2.split(frame, [*self.planes])
        planes = self.planes.reshape(len(self.planes), -1)
        forward(planes, self.rest, self.hidden, self.tops, self.requantised, self.last, self.normal)
        return self.normal
