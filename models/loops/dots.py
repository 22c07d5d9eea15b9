"""Compiled loops over one frame's marker dots: what follows them, and what bridges the slopes under them.

Equal to models/integer on every value.
"""

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.integer.dot_windows import BLOCK, CELL
from fastac.store.compiled_loops import compiled

_compiled = compiled(error_model="numpy")


@_compiled
def _cell_sums(frame, threshold, sums):
    """The darkness of a frame (H, W, C), summed over all cells above and left of each corner.

    sums : (H / CELL + 1, W / CELL + 1, 3) int64: darkness, and its moments of u and v about the image's first
        cell in half pixels; its first row and column are 0
    """
    rows, columns, _ = sums.shape
    channels = frame.shape[2]
    for r in range(rows - 1):
        mass_left = moment_u_left = moment_v_left = 0
        for c in range(columns - 1):
            for i in range(CELL):
                v = CELL * r + i
                for j in range(CELL):
                    u = CELL * c + j
                    dark = threshold[v // BLOCK, u // BLOCK]
                    for channel in range(channels):
                        dark -= frame[v, u, channel]
                    if dark > 0:
                        mass_left += dark
                        moment_u_left += dark * (2 * u - (CELL - 1))
                        moment_v_left += dark * (2 * v - (CELL - 1))
            sums[r + 1, c + 1, 0] = sums[r, c + 1, 0] + mass_left
            sums[r + 1, c + 1, 1] = sums[r, c + 1, 1] + moment_u_left
            sums[r + 1, c + 1, 2] = sums[r, c + 1, 2] + moment_v_left


@_compiled
def _window(sums, column, row, side, out):
    """The window (column, row) of `side` × `side` cells as integer.DotWindows has it, into `out` (3,)."""
    for k in range(3):
        out[k] = (
            sums[row + side, column + side, k]
            - sums[row, column + side, k]
            - sums[row + side, column, k]
            + sums[row, column, k]
        )
    half = side // 2
    out[1] -= 2 * CELL * (column + half) * out[0]
    out[2] -= 2 * CELL * (row + half) * out[0]


@_compiled
def _follow(sums, half, last, rest, rest_px, first_low, first_high, guides, low, high, travel, shift, seen):
    """`DotFollower.__call__` on one frame's sums; `travel` (M + 1, 2) is scratch whose last row is 0."""
    window, place, expected = np.empty(3, np.int64), np.empty(2, np.int64), np.empty(2, np.int64)
    for j in range(len(rest)):
        for axis in range(2):
            expected[axis] = (travel[guides[j, 0], axis] + travel[guides[j, 1], axis] + 1) >> 1
            first = (rest_px[j, axis] + expected[axis]) // CELL - half
            place[axis] = min(max(first, first_low[j, axis]), first_high[j, axis])
        _window(sums, place[0], place[1], 2 * half + 1, window)
        for axis in range(2):
            step = 0
            for k in range(half):
                edge = window[0] * (2 * CELL * k + CELL)
                step += window[1 + axis] > edge
                step -= window[1 + axis] < -edge
            place[axis] = min(max(place[axis] + step, 0), last[axis])
        _window(sums, place[0], place[1], 2 * half + 1, window)
        seen[j] = low[j] <= window[0] <= high[j]
        for axis in range(2):
            shift[j, axis], travel[j, axis] = 0, expected[axis]
            if seen[j]:
                moment, mass = window[1 + axis], max(window[0], 1)
                size = (((abs(moment) << FRACTION) // mass) + 1) >> 1
                centre = (2 * CELL * (place[axis] + half) + CELL - 1) << (FRACTION - 1)
                moved = centre + (size if moment > 0 else -size) - rest[j, axis]
                shift[j, axis] = moved
                travel[j, axis] = (moved + (1 << (FRACTION - 1))) >> FRACTION


@_compiled
def dark_pixels(frame, threshold, first, dark):
    """`integer.SlopeBridge.dark` of rows of a frame (H, W, C), from `first` on, into `dark` (rows, W)
    bool."""
    rows, width = dark.shape
    for i in range(rows):
        v = first + i
        for u in range(width):
            total = 0
            for channel in range(frame.shape[2]):
                total += frame[v, u, channel]
            dark[i, u] = total < threshold[v // BLOCK, u // BLOCK]


@_compiled
def bridge(dark, reach, p_x, q_y, over):
    """`integer.SlopeBridge` of rows of slopes p and q (rows · W,), in place; returns how many of them
    saturated.

    dark : (rows, W); over : (2, rows · W or more) bool, which slopes saturated before, or no elements
    """
    rows, width = dark.shape
    saturated = 0
    for i in range(rows):
        for u in range(width):
            column = u
            if dark[i, u]:
                for distance in range(1, reach + 1):
                    if u >= distance and not dark[i, u - distance]:
                        column = u - distance
                        break
                    if u + distance < width and not dark[i, u + distance]:
                        column = u + distance
                        break
                p_x[i * width + u], q_y[i * width + u] = p_x[i * width + column], q_y[i * width + column]
            if over.size:
                saturated += over[0, i * width + column] + over[1, i * width + column]
    return saturated


@_compiled
def follow(frame, threshold, sums, arguments):
    """Find the dots of a frame (H, W, C) uint8; the others are `FollowedDots.tables`, which hold the
    results."""
    _cell_sums(frame, threshold, sums)
    _follow(sums, *arguments)


class FollowedDots:
    """The dots of frames, one after another, in scratch memory for one frame at a time."""

    def __init__(self, follower: DotFollower):
        windows = follower.windows
        height, width = windows.image
        count = len(follower.rest)
        self.threshold = windows.threshold.astype(np.int64)
        self.sums = np.zeros((height // CELL + 1, width // CELL + 1, 3), np.int64)
        self.shift, self.seen = np.zeros((count, 2), np.int64), np.zeros(count, np.bool_)
        tables = (
            np.array(windows.shape[::-1]) - 1,
            follower.rest,
            follower.rest_px,
            *follower.first_windows,
            follower.guides,
            follower.low,
            follower.high,
        )
        tables = (np.ascontiguousarray(table, np.int64) for table in tables)
        self.arguments = (windows.half, *tables, np.zeros((count + 1, 2), np.int64), self.shift, self.seen)

        self.tables = (self.threshold, self.sums, self.arguments)
        """What `follow` takes after the frame."""

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A frame (H, W, C) uint8 to shifts (M, 2) in px · 2**FRACTION and whether dots are seen, (M,) bool.

        Both are views of scratch memory, which the next frame overwrites.
        """
        follow(frame, *self.tables)
        return self.shift, self.seen


def _no_dots() -> tuple:
    shape, pairs, one = np.zeros((0, 0), np.int64), np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    follower = (0, one, *(pairs,) * 5, one, one, pairs, pairs, np.zeros(0, np.bool_))
    return shape, np.zeros((0, 0, 3), np.int64), follower


NO_DOTS = _no_dots()
"""In place of `FollowedDots.tables` where there is nothing to follow: the same types, no dots."""
