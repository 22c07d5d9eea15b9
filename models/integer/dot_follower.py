"""The shifts of marker dots from their places at rest, in integers, from moments in windows.

Dots are followed one after another. Where a dot is looked for follows from the shifts of two neighbours that
were found before it, so that dots may travel farther than half their spacing, as long as neighbours travel
alike. Around that place a first window is taken, around the darkness's centre in it a second one, whose
centre is the dot's: two steps of mean shift (Comaniciu and Meer, "Mean shift: a robust approach toward
feature space analysis", IEEE Transactions on Pattern Analysis and Machine Intelligence 24, 2002).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.dot_windows import CELL, DotWindows
from fastac.models.integer.words import signed_width

FRACTION = 6
"""Fractional bits of positions and shifts in px."""


@dataclass(frozen=True, eq=False)
class DotFollower:
    """Follows M dots through the windows of a frame.

    The farther dots are from the order of their rows of windows, the more rows the hardware has to keep. A
    dot is seen if its second window's sum is within `low` and `high`; a lost dot has a shift of 0. Hardware
    whose thresholds of darkness can be loaded may also be loaded with other places, guides and limits of as
    many dots.
    """

    windows: DotWindows
    rest: np.ndarray  # (M, 2): u and v of each dot at rest, in px · 2**FRACTION
    guides: np.ndarray  # (M, 2): indices of two earlier dots whose mean shift predicts this one's; M: none
    low: np.ndarray  # (M,)
    high: np.ndarray  # (M,)
    reach: int
    """Largest distance, in windows along each axis, of the first window from that of the dot at rest."""

    def __post_init__(self):
        count = len(self.rest)
        if not count:
            raise ValueError("rest: no dots to follow")
        if self.low.min() < 1:
            raise ValueError(f"low {self.low.min()}: expected at least 1, for nothing is no dot")
        if (self.low > self.high).any():
            raise ValueError("low, high: expected low to be at most high")
        if self.rest.min() < 0 or (self.rest_px >= self.windows.image[::-1]).any():
            raise ValueError("rest: expected places inside the image")
        earlier = (self.guides >= 0) & (self.guides < np.arange(count)[:, None])
        if not (earlier | (self.guides == count)).all():
            raise ValueError(f"guides: expected indices of earlier dots, or {count} for none")

    @property
    def rest_px(self) -> np.ndarray:
        """The pixels nearest to the dots at rest, (M, 2)."""
        return _nearest(self.rest)

    @property
    def loadable(self) -> bool:
        """Whether the hardware may be loaded with other dots."""
        return self.windows.loadable

    @property
    def _last(self) -> np.ndarray:
        """The last column and row of windows."""
        return np.array(self.windows.shape[::-1]) - 1

    @property
    def first_windows(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest column and row of each dot's first window, (M, 2) each."""
        return self._first_windows(self.rest)

    def _first_windows(self, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`first_windows` of dots at `rest` (M, 2)."""
        window = np.clip(_nearest(rest) // CELL - self.windows.half, 0, self._last)
        return np.maximum(window - self.reach, 0), np.minimum(window + self.reach, self._last)

    @property
    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """The first and the last row of windows that each dot may read, (M,) each."""
        low, high = self.first_windows
        half = self.windows.half
        return np.maximum(low[:, 1] - half, 0), np.minimum(high[:, 1] + half, self._last[1])

    @property
    def needed_rows(self) -> np.ndarray:
        """The first row of windows that each dot or a later one may read, (M,)."""
        first, _ = self.rows
        return np.minimum.accumulate(first[::-1])[::-1]

    @property
    def possible_rest(self) -> np.ndarray:
        """What `rest` may hold along u and v, (…, 2): what it does or, where other dots can be loaded, all
        places inside the image."""
        if not self.loadable:
            return self.rest
        ends = (np.array(self.windows.image[::-1]) << FRACTION) - (1 << (FRACTION - 1)) - 1
        return np.minimum(np.arange(ends.max() + 1)[:, None], ends)

    def centre(self, window: np.ndarray) -> np.ndarray:
        """Centres of windows (…, 2) of indices, in px · 2**FRACTION."""
        return (2 * CELL * (window + self.windows.half) + CELL - 1) << (FRACTION - 1)

    @cached_property
    def bound(self) -> int:
        """The largest magnitude of a shift: the farthest window, and darkness at its edge alone."""
        half, rest = self.windows.half, self.possible_rest
        low, high = self._first_windows(rest)
        edge = (CELL * (2 * half + 1) - 1) << (FRACTION - 1)
        lowest = self.centre(np.maximum(low - half, 0)) - edge - rest
        highest = self.centre(np.minimum(high + half, self._last)) + edge - rest
        return int(np.abs([lowest, highest]).max())

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def step(self, window: np.ndarray) -> np.ndarray:
        """By how many windows the centre of darkness is away from that of windows (…, 3), (…, 2)."""
        mass, moment = window[..., :1], window[..., 1:]
        edges = 2 * CELL * np.arange(self.windows.half) + CELL
        beyond = (moment[..., None] > mass[..., None] * edges).sum(axis=-1)
        return beyond - (moment[..., None] < -mass[..., None] * edges).sum(axis=-1)

    @staticmethod
    def offset(window: np.ndarray) -> np.ndarray:
        """The centre of darkness in windows (…, 3) relative to theirs, (…, 2) in px · 2**FRACTION.

        Rounded to the nearest, halves away from zero; 0 without darkness.
        """
        mass, moment = np.maximum(window[..., :1], 1), window[..., 1:]
        return np.sign(moment) * ((((np.abs(moment) << FRACTION) // mass) + 1) >> 1)

    def __call__(self, windows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Windows (..., rows, columns, 3) to shifts (..., M, 2) in px · 2**FRACTION, and whether each dot is
        seen, (..., M) bool."""
        *outer, _, _, _ = windows.shape
        flat = windows.reshape(-1, *windows.shape[-3:])
        frames, count = np.arange(len(flat)), len(self.rest)
        travel = np.zeros((len(flat), count + 1, 2), np.int64)  # whole pixels; the last is that of no guide
        shift = np.zeros((len(flat), count, 2), np.int64)
        seen = np.zeros((len(flat), count), bool)
        low, high = self.first_windows
        for j, guides in enumerate(self.guides):
            expected = (travel[:, guides].sum(axis=1) + 1) >> 1
            first = (self.rest_px[j] + expected) // CELL - self.windows.half
            first = np.clip(first, low[j], high[j])
            second = first + self.step(flat[frames, first[:, 1], first[:, 0]])
            second = np.clip(second, 0, self._last)
            found = flat[frames, second[:, 1], second[:, 0]]
            seen[:, j] = (found[:, 0] >= self.low[j]) & (found[:, 0] <= self.high[j])
            moved = self.centre(second) + self.offset(found) - self.rest[j]
            whole = (moved + (1 << (FRACTION - 1))) >> FRACTION
            travel[:, j] = np.where(seen[:, j, None], whole, expected)
            shift[:, j] = np.where(seen[:, j, None], moved, 0)
        return shift.reshape(*outer, count, 2), seen.reshape(*outer, count)


def _nearest(rest: np.ndarray) -> np.ndarray:
    """The pixels nearest to places in px · 2**FRACTION."""
    return (rest + (1 << (FRACTION - 1))) >> FRACTION


def guides_of(places: np.ndarray, spacing: float) -> np.ndarray:
    """For each of `places` (M, 2) two earlier ones near it, (M, 2) of indices; M for none.

    The nearest earlier place no farther than 1.6 spacings, and the nearest in a direction that differs from
    its by 45° or more; the first one twice where there is no other.
    """
    guides = np.full((len(places), 2), len(places))
    for j in range(1, len(places)):
        way = places[:j] - places[j]
        distance = np.linalg.norm(way, axis=-1)
        first, *others = np.argsort(distance, kind="stable")
        if distance[first] > 1.6 * spacing:
            continue
        cosine = way @ way[first] / np.maximum(distance * distance[first], 1e-12)
        across = [k for k in others if distance[k] <= 1.6 * spacing and cosine[k] <= np.sqrt(0.5) + 1e-9]
        guides[j] = first, across[0] if across else first
    return guides


def at_rest(
    windows: DotWindows, background: np.ndarray, places_px: np.ndarray, *, spacing_px: float, reach: int
) -> DotFollower:
    """The follower of the dots at `places_px` (M, 2), u and v, in the background frame (H, W, C) uint8.

    Each dot's place and darkness at rest are what the windows themselves show of the background. Raises
    ValueError for a place at which the background shows no darkness.
    """
    last = np.array(windows.shape[::-1]) - 1
    seen = windows(background)
    nearest = np.floor(places_px + 0.5).astype(np.int64)
    window = np.clip(nearest // CELL - windows.half, 0, last)
    order = np.lexsort((window[:, 0], window[:, 1]))
    nearest, window = nearest[order], window[order]
    draft = DotFollower(
        windows,
        nearest << FRACTION,
        np.full((len(nearest), 2), len(nearest)),
        *np.ones((2, len(nearest)), np.int64),
        reach,
    )
    window = np.clip(window + draft.step(seen[window[:, 1], window[:, 0]]), 0, last)
    found = seen[window[:, 1], window[:, 0]]
    if not found[:, 0].all():
        u, v = nearest[np.flatnonzero(found[:, 0] == 0)[0]]
        raise ValueError(f"dot at {u}, {v} px: the background is not dark there")
    rest, mass = draft.centre(window) + draft.offset(found), found[:, 0]
    # What is found may be in another row of windows than where it was looked for.
    row = np.clip(_nearest(rest) // CELL - windows.half, 0, last)
    order = np.lexsort((row[:, 0], row[:, 1]))
    rest, mass = rest[order], mass[order]
    guides = guides_of(rest / (1 << FRACTION), spacing_px)
    return DotFollower(windows, rest, guides, np.maximum(mass // 2, 1), mass * 3 // 2, reach)
