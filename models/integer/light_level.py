"""The light's drift taken out of a frame: each channel is shifted until it lies about its background again.

Exposure, white balance and lamps differ from frame to frame, and a shift of a whole channel looks to the
network like a slope everywhere. Most of a frame is not in contact, so the median of the difference from the
background is the light's. A camera's frames follow one another closely: the hardware moves the shift of each
channel by at most one digital number a frame, towards the median, and so needs no frame in memory.
"""

import numpy as np

DARKEST, BRIGHTEST = 16, 254
"""Backgrounds between these are lit: darker pixels do not see the lamps, brighter ones are saturated."""
SHIFT_LIMIT = 63
"""Largest magnitude of a shift, in digital numbers."""


def lit(background: np.ndarray) -> np.ndarray:
    """Which values of a background (H, W, C) uint8 are lit: these are shifted, and all but those of the last
    row count for the median."""
    return (background >= DARKEST) & (background <= BRIGHTEST)


def settled_shift(frames: np.ndarray, background: np.ndarray) -> np.ndarray:
    """The shift of each channel at which a sensor that sees only this frame comes to rest, (frames, C) int64.

    frames : (frames, H, W, C) uint8; background : (H, W, C) uint8
    It is the median of frame − background over the lit values, and of the medians of an even number of values
    the nearest to 0; within ±SHIFT_LIMIT, and 0 where nothing is lit. Values that are clipped lie above or
    below every shift.
    """
    seen = lit(background)
    seen[-1] = False
    shifts = np.zeros((len(frames), background.shape[-1]), np.int64)
    for channel in range(background.shape[-1]):
        where = np.flatnonzero(seen[..., channel])
        if not len(where):
            continue
        at_rest = background[..., channel].reshape(-1)[where].astype(np.int64)
        lower, upper = (len(where) + 1) // 2, len(where) // 2 + 1
        for k, frame in enumerate(frames):
            values = frame[..., channel].reshape(-1)[where].astype(np.int64)
            difference = np.select([values == 0, values == 255], [-255, 255], values - at_rest)
            smaller = np.bincount(255 + difference, minlength=511).cumsum()
            medians = np.searchsorted(smaller, (lower, upper)) - 255
            shifts[k, channel] = np.clip(0, *medians)
    return np.clip(shifts, -SHIFT_LIMIT, SHIFT_LIMIT)


def shifted(frames: np.ndarray, background: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Frames (frames, H, W, C) uint8 less shifts (frames, C) where the background is lit, within 0 … 255.

    Clipped values, 0 and 255, stay as they are, so that they still count as clipped.
    """
    seen, result = lit(background), np.empty_like(frames)
    for k, (frame, shift) in enumerate(zip(frames, shifts, strict=True)):
        moved = seen & (frame > 0) & (frame < 255)
        result[k] = np.clip(frame - shift * moved, 0, 255)
    return result


def levelled(frames: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Frames (frames, H, W, C) uint8 as a sensor at rest on each of them sees it, of the same shape.

    Levelled frames stay as they are.
    """
    return shifted(frames, background, settled_shift(frames, background))


def next_shift(seen_frame: np.ndarray, background: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The shift (C,) of the frame after one, (H, W, C) uint8, that has been shifted by `shift`.

    A channel's shift grows by one where more than half of its lit values, without the last row, lie above
    their background, and falls by one where more than half lie below it; within ±SHIFT_LIMIT.
    """
    seen, at_rest = lit(background)[:-1], background[:-1]
    half = seen.sum(axis=(0, 1)) / 2
    above = (seen & (seen_frame[:-1] > at_rest)).sum(axis=(0, 1)) > half
    below = (seen & (seen_frame[:-1] < at_rest)).sum(axis=(0, 1)) > half
    return np.clip(shift + above - below, -SHIFT_LIMIT, SHIFT_LIMIT)


def followed(
    frames: np.ndarray, background: np.ndarray, shift: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Consecutive frames (frames, H, W, C) uint8 as the hardware shifts them, and the shift (C,) of the next.

    shift : of the first frame, (C,); None: 0, as after a reset
    """
    shift = np.zeros(background.shape[-1], np.int64) if shift is None else shift
    result = np.empty_like(frames)
    for k, frame in enumerate(frames):
        result[k] = shifted(frame[None], background, shift[None])[0]
        shift = next_shift(result[k], background, shift)
    return result, shift
