"""Fault injection into frames: gain and offset drift, failing lights, dead pixels, defocus, damaged dots.

Frames are (N, H, W, C) uint8; each function returns new ones, rounded and clipped to 0 … 255.
"""

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter


def _pixels(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def gain(frames: np.ndarray, factor: float | np.ndarray) -> np.ndarray:
    """Frames of a camera with `factor` times the gain, or of lights `factor` times as bright.

    factor : one for all channels, or one each, (channels,)
    """
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


def _discs(shape: tuple[int, int], centres_px: np.ndarray, radius_px: float) -> np.ndarray:
    """Pixels (H, W) bool within `radius_px` of any of the centres (M, 2), u and v."""
    v, u = np.indices(shape)
    away = np.hypot(u - centres_px[:, 0, None, None], v - centres_px[:, 1, None, None])
    return (away <= radius_px).any(axis=0)


def covered_dots(frames: np.ndarray, centres_px: np.ndarray, radius_px: float) -> np.ndarray:
    """Frames whose dots at the centres (N, M, 2) are painted over: each with the brightest skin around it."""
    size = 2 * int(np.ceil(2 * radius_px)) + 1
    changed = frames.copy()
    for frame, centres in zip(changed, centres_px, strict=True):
        skin = maximum_filter(frame, size=(size, size, 1), mode="nearest")
        hidden = _discs(frame.shape[:2], centres, radius_px + 1)
        frame[hidden] = skin[hidden]
    return changed


def smeared_dots(frames: np.ndarray, centres_px: np.ndarray, radius_px: float) -> np.ndarray:
    """Frames whose dots at the centres (N, M, 2) are smeared over thrice their width, each as dark as its
    centre."""
    changed = frames.copy()
    for frame, centres in zip(changed, centres_px, strict=True):
        for centre in centres:
            u, v = np.rint(centre).astype(int)
            streak = centre + np.array([(step * radius_px, 0) for step in (-2, -1, 0, 1, 2)])
            frame[_discs(frame.shape[:2], streak, radius_px)] = frame[v, u]
    return changed


def added_dots(frames: np.ndarray, centres_px: np.ndarray, radius_px: float, value: int = 10) -> np.ndarray:
    """Frames with a dark spot of `value` in every channel at each of the centres (N, M, 2), such as dirt."""
    changed = frames.copy()
    for frame, centres in zip(changed, centres_px, strict=True):
        frame[_discs(frame.shape[:2], centres, radius_px)] = value
    return changed
