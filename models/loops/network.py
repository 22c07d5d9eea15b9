"""The pixel network on whole frames: weights in the compiled loops' layout, with their scratch memory."""

from collections.abc import Sequence

import cv2
import numpy as np

from fastac.models.integer.features import coordinate_codes
from fastac.models.loops.network_kernel import forward, packed


class FrameNetwork:
    """The pixel network for one thread, called with one frame after another.

    tables : weights of each layer, (neurons, inputs + 1), the bias in the last column. The hidden layers have
        one element type, the last layer may have another; each is computed in its type.
    background : (H, W, C) uint8
    requantise : for each hidden layer the factors multiplier · 2**−shift, (neurons,), and the largest
        activation, as in `integer.network.Requantisation`; None for rectified activations (ReLU) alone
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
        self.requantised = requantise is not None
        steps = requantise if self.requantised else [(None, 0)] * len(hidden)
        layers = [packed(table, scale) for table, (scale, _) in zip(hidden, steps, strict=True)]
        shapes = np.array([layer.shape for layer in layers], int).reshape(-1, 3)
        self.hidden = np.zeros((len(layers), *shapes.max(axis=0, initial=1)), tables[0].dtype)
        for place, layer in zip(self.hidden, layers, strict=True):
            place[: layer.shape[0], : layer.shape[1]] = layer
        self.neurons = np.array([len(table) for table in hidden], np.int64)
        self.tops = np.array([top for _, top in steps], tables[0].dtype)
        self.last = packed(last)
        self.planes = np.empty((channels, height, width), np.uint8)
        rest = np.empty((channels + 2, height, width), np.float32)
        rest[:channels] = np.moveaxis(background, -1, 0)
        rest[channels] = coordinate_codes(width)
        rest[channels + 1] = coordinate_codes(height)[:, None]
        self.rest = rest.reshape(channels + 2, -1)
        self.normal = np.empty((len(last), height * width), last.dtype)

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """The network's outputs (3, H · W) for a frame (H, W, C) uint8; overwritten by the next call."""
        cv2.split(frame, [*self.planes])
        planes = self.planes.reshape(len(self.planes), -1)
        tables = self.hidden, self.neurons, self.tops, self.requantised, self.last
        forward(planes, self.rest, *tables, self.normal)
        return self.normal
