"""What the pixel network sees: intensity differences from the background, and where the pixel is.

Integer features are the contract between camera and network: ΔI in −255 … 255 and coordinate codes in
−127 … 127; the float network sees the same numbers, scaled.
"""

import numpy as np

from fastac.models.integer.smoothing import smoothed

DIFFERENCE_SCALE = 1 / 64
COORDINATE_SCALE = 1 / 127
HIDDEN = (16, 16, 16)
"""Neurons of the pixel network's hidden layers."""
WIDTH = 9
"""Bits of a feature, the network's signed input: a difference of two bytes, or a coordinate."""


def coordinate_codes(size: int) -> np.ndarray:
    """Pixel centres along one axis as −127 … 127, (size,) int64."""
    return np.rint(np.linspace(-127, 127, size)).astype(np.int64)


def differences(frames: np.ndarray, background: np.ndarray, smoothing_px: int = 0) -> np.ndarray:
    """ΔI of frames (..., H, W, C) uint8 from a background (H, W, C) uint8, (..., H, W, C) int16.

    smoothing_px : side of the window over which they are averaged, see `smoothing.smoothed`; 0: none
    """
    found = np.subtract(frames, background, dtype=np.int16)
    return smoothed(found, smoothing_px) if smoothing_px else found


def integer_features(frames: np.ndarray, background: np.ndarray, smoothing_px: int = 0) -> np.ndarray:
    """Frames (..., H, W, C) uint8 and background (H, W, C) uint8 to features (..., H, W, C + 2) int16.

    Order: ΔI of each channel as `differences`, then the coordinate code of u, then of v.
    """
    height, width, channels = background.shape
    features = np.empty((*frames.shape[:-1], channels + 2), dtype=np.int16)
    features[..., :channels] = differences(frames, background, smoothing_px)
    features[..., channels] = coordinate_codes(width)
    features[..., channels + 1] = coordinate_codes(height)[:, None]
    return features


def scales(channels: int) -> np.ndarray:
    """Float value of one unit of each feature, (channels + 2,)."""
    return np.array([DIFFERENCE_SCALE] * channels + [COORDINATE_SCALE] * 2)


def limits(channels: int) -> np.ndarray:
    """Largest magnitude of each integer feature, (channels + 2,)."""
    return np.array([255] * channels + [127] * 2)
