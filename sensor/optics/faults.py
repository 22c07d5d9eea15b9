"""What goes wrong with a sensor in use, done to good frames: drift, lights, pixels, focus."""

import numpy as np
from scipy.ndimage import gaussian_filter


def _pixels(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def gain(frames: np.ndarray, factor: float) -> np.ndarray:
    """Frames (N, H, W, C) uint8 as a camera of `factor` times the gain, or lights as bright, would send."""
    return _pixels(frames.astype(np.float32) * factor)


def offset(frames: np.ndarray, offset_dn: float) -> np.ndarray:
    """The same with so many digital numbers more in every pixel."""
    return _pixels(frames.astype(np.float32) + offset_dn)


def dimmed(frames: np.ndarray, channel: int, factor: float) -> np.ndarray:
    """One channel's light at `factor` of its brightness; 0: it has failed."""
    values = frames.astype(np.float32)
    values[..., channel] *= factor
    return _pixels(values)


def dead_pixels(frames: np.ndarray, share: float, seed: int = 1) -> np.ndarray:
    """A share of the sensor's pixels, the same in all frames, at 0 or at 255, each in all its channels."""
    rng = np.random.default_rng(seed)
    height, width = frames.shape[1:3]
    dead = rng.permutation(height * width)[: round(share * height * width)]
    changed = frames.copy()
    stuck = rng.choice(np.array([0, 255], np.uint8), (len(dead), 1))
    changed.reshape(len(frames), height * width, -1)[:, dead] = stuck
    return changed


def defocused(frames: np.ndarray, sigma_px: float) -> np.ndarray:
    """Blurred by a Gaussian of so many pixels; edges are continued."""
    if not sigma_px:
        return frames.copy()
    blurred = gaussian_filter(frames.astype(np.float32), (0, sigma_px, sigma_px, 0), mode="nearest")
    return _pixels(blurred)
