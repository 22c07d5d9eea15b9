"""The pixel network on frames: weights in the compiled loops' layout."""

from collections.abc import Sequence

import numpy as np

from fastac.models.integer.features import coordinate_codes, differences
from fastac.models.loops.network_kernel import forward_whole, packed


class FrameNetwork:
    """The pixel network, for any number of threads.

    tables : weights of each layer, (neurons, inputs + 1), the bias in the last column. The hidden layers have
        one element type, the last layer may have another; each is computed in its type.
    background : (H, W, C) uint8
    smoothing_px : side of the window over which differences from the background are averaged; 0: none
    requantise : for each hidden layer the factors multiplier · 2**−shift, (neurons,), and the largest
        activation, as in `integer.network.Requantisation`; None for rectified activations (ReLU) alone
    """

    def __init__(
        self,
        tables: Sequence[np.ndarray],
        background: np.ndarray,
        *,
        requantise: Sequence[tuple[np.ndarray, int]] | None = None,
        smoothing_px: int = 0,
    ):
        height, width, channels = background.shape
        *hidden, last = tables
        steps = requantise if requantise is not None else [(None, 0)] * len(hidden)
        layers = [packed(table, scale) for table, (scale, _) in zip(hidden, steps, strict=True)]
        shapes = np.array([layer.shape for layer in layers], int).reshape(-1, 3)
        together = np.zeros((len(layers), *shapes.max(axis=0, initial=1)), tables[0].dtype)
        for place, layer in zip(together, layers, strict=True):
            place[: layer.shape[0], : layer.shape[1]] = layer
        rest = np.empty((channels + 2, height, width), np.float32)
        # Smoothed differences are found before the compiled loops, which then take nothing off.
        rest[:channels] = 0 if smoothing_px else np.moveaxis(background, -1, 0)
        rest[channels] = coordinate_codes(width)
        rest[channels + 1] = coordinate_codes(height)[:, None]
        self.background, self.smoothing_px = background, smoothing_px
        self.real, self.outputs = last.dtype, len(last)
        self.tables = (
            rest.reshape(channels + 2, -1),
            together,
            np.array([len(table) for table in hidden], np.int64),
            np.array([top for _, top in steps], tables[0].dtype),
            requantise is not None,
            packed(last),
        )
        """What `network_kernel.forward` takes between the frame and the first pixel."""

    def seen(self, frames: np.ndarray) -> np.ndarray:
        """What `network_kernel.forward` takes of frames (frames, H, W, C) uint8, (frames, H · W · C): their
        bytes, or their smoothed differences, int16."""
        if self.smoothing_px:
            frames = differences(frames, self.background, self.smoothing_px)
        return frames.reshape(len(frames), -1)

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """The network's outputs (3, H · W) for a frame (H, W, C) uint8."""
        found = np.empty((self.outputs, frame.shape[0] * frame.shape[1]), self.real)
        forward_whole(self.seen(np.ascontiguousarray(frame)[None])[0], *self.tables, found)
        return found
