"""Fault injection into frames: gain and offset drift, failing lights, dead pixels, defocus.

Frames are (N, H, W, C) uint8; each function returns new ones, rounded and clipped to 0 … 255.
"""

import numpy as np
from scipy.ndimage import gaussian_filter


def _pixels(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def gain(frames: np.ndarray, factor: float) -> np.ndarray:
    """Frames of a camera with `factor` times the gain, or of lights `factor` times as bright."""
    return _pixels(frames.astype(np.float32) * factor)


def offset(frames: np.ndarray, offset_dn: float) -> np.ndarray:
    """Frames with `offset_dn` digital numbers added to every pixel, as by a drifting black level."""
    return _pixels(frames.astype(np.float32) + offset_dn)


def dimmed(frames: np.ndarray, channel: int, factor: float) -> np.ndarray:
    """Frames with one channel's light at `factor` times its brightness; 0 is a light that has failed."""
    values = frames.astype(np.float32)
    values[..., channel] *= factor
    return _pixels(values)


def dead_pixels(frames: np.ndarray, share: float, seed: int = 1) -> np.ndarray:
    """Frames in which a share of the pixels, the same in all frames, is stuck at 0 or 255 in every
    channel."""
    rng = np.random.default_rng(seed)
    height, width = frames.shape[1:3]
    dead = rng.permutation(height * width)[: round(share * height * width)]
    changed = frames.copy()
    stuck = rng.choice(np.array([0, 255], np.uint8), (len(dead), 1))
    changed.reshape(len(frames), height * width, -1)[:, dead] = stuck
    return changed


def defocused(frames: np.ndarray, sigma_px: float) -> np.ndarray:
    """Frames blurred by a Gaussian with a standard deviation of `sigma_px`; edge pixels are repeated
    outwards."""
    if not sigma_px:
        return frames.copy()
    blurred = gaussian_filter(frames.astype(np.float32), (0, sigma_px, sigma_px, 0), mode="nearest")
    return _pixels(blurred)
