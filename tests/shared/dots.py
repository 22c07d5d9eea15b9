"""Frames with dark dots for tests, and windows as payloads of the hardware."""

import numpy as np

from fastac.gateware.dots.follower import dot_layout
from fastac.gateware.dots.window_stream import window_layout
from fastac.models.integer.dot_follower import DotFollower, at_rest
from fastac.models.integer.dot_windows import DotWindows

SPACING_PX, RADIUS_PX, SKIN = 10, 1.8, 150


def places(height: int, width: int) -> np.ndarray:
    """u and v of dots near the points of a grid, each with other fractions of a pixel, (M, 2)."""
    u, v = (np.arange(7, side - 6, SPACING_PX) for side in (width, height))
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return grid + np.outer(np.arange(1, len(grid) + 1), (0.618, 0.414)) % 1 * 0.9 - 0.4


def frame(height: int, width: int, centres: np.ndarray, channels: int = 4) -> np.ndarray:
    """A skin of one brightness with a dot at each of `centres` (M, 2), (H, W, C) uint8."""
    v, u = np.indices((height, width))
    away = np.hypot(u - centres[:, 0, None, None], v - centres[:, 1, None, None])
    covered = np.clip(RADIUS_PX + 0.5 - away, 0, 1).max(axis=0) if len(centres) else 0 * u
    bright = np.rint(SKIN * (1 - 0.9 * covered))
    return np.repeat(bright[..., None], channels, axis=-1).astype(np.uint8)


def follower(height: int, width: int, *, half: int = 1, reach: int = 3, channels: int = 4) -> DotFollower:
    """The follower of the dots on the grid."""
    threshold = np.full((height // 4, width // 4), int(0.75 * SKIN * channels))
    windows = DotWindows(threshold, channels, half)
    rest = places(height, width)
    background = frame(height, width, rest, channels)
    return at_rest(windows, background, rest, spacing_px=SPACING_PX, reach=reach)


def packed(layout, values) -> int:
    """One payload of `layout` with these values of its fields, in their order."""
    fields = (layout[name] for name in layout.members)
    return sum(
        (int(value) & ((1 << field.width) - 1)) << field.offset
        for field, value in zip(fields, values, strict=True)
    )


def payloads(windows: DotWindows, found: np.ndarray, per_beat: int) -> list[int]:
    """Windows (frames, rows, columns, 3) as payloads of beats."""
    layout = window_layout(windows)
    return [
        sum(packed(layout, values) << (k * layout.size) for k, values in enumerate(beat))
        for beat in found.reshape(-1, per_beat, 3)
    ]


def shift_payloads(follower: DotFollower, shift: np.ndarray, seen: np.ndarray) -> list[int]:
    """Shifts (frames, M, 2) and whether each dot is seen (frames, M) as payloads."""
    layout = dot_layout(follower)
    rows = zip(shift.reshape(-1, 2).tolist(), seen.ravel().tolist(), strict=True)
    return [packed(layout, (*moved, known)) for moved, known in rows]
