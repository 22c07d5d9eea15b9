"""Frames as a sensor sees them whose light and camera have drifted, as far as nobody notices."""

import numpy as np

from fastac.models.integer.frame_validity import REASONS, FrameValidity

HALVINGS = 6
"""How often a drift that flags its frame is made half as large before it is given up."""


def drifted(frames: np.ndarray, background: np.ndarray, validity: FrameValidity, seed: int) -> np.ndarray:
    """Frames (frames, H, W, C) uint8 with a gain and an offset of their own in each channel.

    Drifts are drawn so that an untouched sensor's brightness stays within the limits of `validity`; one that
    flags its frame by a measure of the pixels is made smaller. Values between two digital numbers become
    either by chance, as noise makes them in a camera.
    """
    rng = np.random.default_rng(seed)
    height, width, channels = background.shape
    names = [REASONS[1 + c] for c in range(channels)]
    place = [validity.names.index(name) for name in names]
    low, high = (limits[place] / (height * width) for limits in (validity.low, validity.high))
    mean = np.maximum(background.reshape(-1, channels).mean(axis=0), 1)
    found = np.empty_like(frames)
    for k, frame in enumerate(frames):
        change = rng.uniform(low, high)
        by_gain = rng.uniform(0, 1, channels)
        chance = rng.random(frame.shape, np.float32)
        found[k] = frame
        for _ in range(HALVINGS):
            values = frame * (1 + by_gain * change / mean) + (1 - by_gain) * change
            trial = np.clip(np.floor(values + chance), 0, 255).astype(np.uint8)
            if not _flagged(trial, background, validity):
                found[k] = trial
                break
            change = change / 2
    return found


def _flagged(frame: np.ndarray, background: np.ndarray, validity: FrameValidity) -> bool:
    """Whether a measure of the pixels alone flags the frame."""
    measures = validity.of_pixels(frame, background)
    count = len(measures)
    return bool(((measures < validity.low[:count]) | (measures > validity.high[:count])).any())
