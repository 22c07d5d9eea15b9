"""The mean of ΔI over a square window of pixels: noise averaged away before the network sees it.

The skin is smooth, a camera's noise is not: a mean over w × w pixels has about 1/w of the noise, and keeps
slopes that change little over w pixels. A window of w pixels is centred on one, so that those at its ends lie
inside by half: along each axis w + 1 pixels count by the weights 1, 2, …, 2, 1, whose sum is 2w. As w is a
power of two, hardware needs additions and a shift.
"""

import cv2
import numpy as np

WINDOWS_PX = (2, 4, 8)
"""Sides of the windows that there are."""


def weights(window_px: int) -> np.ndarray:
    """What each pixel counts along an axis of the window, (window_px + 1,) int64."""
    found = np.full(window_px + 1, 2)
    found[[0, -1]] = 1
    return found


def shift(window_px: int) -> int:
    """log2 of the sum of all weights, (2 · window_px)²."""
    return 2 * window_px.bit_length()


def smoothed(difference: np.ndarray, window_px: int) -> np.ndarray:
    """ΔI (..., H, W, C) within ±255, integers, to their means around each pixel, int16, rounded half up.

    window_px : one of WINDOWS_PX; beyond the image its outermost pixels go on
    Exact: float32 holds the sums, 255 · (2 · window_px)² at most.
    """
    if window_px not in WINDOWS_PX:
        raise ValueError(f"window_px {window_px}: expected one of {WINDOWS_PX}")
    taps = weights(window_px).astype(np.float32)
    found = np.empty(difference.shape, np.int16)
    height, width, channels = difference.shape[-3:]
    images = difference.astype(np.float32).reshape(-1, height, width, channels)
    for image, place in zip(images, found.reshape(images.shape), strict=True):
        total = cv2.sepFilter2D(image, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REPLICATE)
        scaled = total.reshape(image.shape) * np.float32(2.0 ** -shift(window_px))
        place[...] = np.floor(scaled + np.float32(0.5))
    return found
