"""Darkness and shifts that drive the words of the dots, and of their spread, to their largest magnitude."""

from dataclasses import replace

import numpy as np

from fastac.gateware.slip.rigid_sums import sums_layout
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.dot_windows import CELL, DotWindows
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.words import signed_width
from fastac.studies.robustness.worst_case import WorstCase, magnitude

PATTERNS = 400
"""Patterns of alternating shifts that are tried, at random, for the largest spread."""
WAYS = np.array([(u, v) for u in (-1, 0, 1) for v in (-1, 0, 1)])


def one_sided(windows: DotWindows, axis: int, sign: int) -> np.ndarray:
    """Darkness (H, W) in the half of one window on one side of its middle, along u (axis 1) or v (axis 0):
    that of the window whose moment becomes largest."""
    side = CELL * (2 * windows.half + 1)
    distance = np.maximum(sign * (2 * np.arange(side) - (side - 1)), 0)
    near = np.lib.stride_tricks.sliding_window_view(windows.largest, (side, side))[::CELL, ::CELL]
    moments = np.moveaxis(near, 2 + axis, -1) @ distance
    row, column = np.unravel_index(moments.sum(axis=-1).argmax(), windows.shape)
    part = [slice(CELL * start, CELL * start + side) for start in (row, column)]
    half = side // 2
    first = part[axis].start + half * (sign > 0)
    part[axis] = slice(first, first + half)
    found = np.zeros_like(windows.largest)
    found[tuple(part)] = windows.largest[tuple(part)]
    return found


def window_cases(windows: DotWindows) -> list[WorstCase]:
    """Sum and moments of darkness in windows, for an image as dark as can be, whole or on one side alone."""
    sides = [one_sided(windows, axis, sign) for axis in (0, 1) for sign in (-1, 1)]
    inputs = np.stack([windows.largest, *sides])
    outputs = windows.of_darkness(inputs)
    note = "any thresholds that can be loaded" if windows.loadable else ""
    rows = [
        ("sum", windows.mass_width + 1, windows.mass_bound, outputs[..., 0]),
        ("moment", windows.moment_width, windows.moment_bound, outputs[..., 1:]),
    ]
    return [
        WorstCase(
            *("windows of dots", word, width, bound, bound),
            *(magnitude(values), windows, inputs, outputs, note),
        )
        for word, width, bound, values in rows
    ]


def shift_case(follower: DotFollower) -> WorstCase:
    """Shifts, for windows of which each has its darkness at the same edge, so that dots seem to travel on and
    on: the sum in all of them is one that most dots are seen with."""
    accepted = (follower.low <= follower.low[:, None]) & (follower.low[:, None] <= follower.high)
    mass = follower.low[accepted.sum(axis=1).argmax()]
    span = CELL * (2 * follower.windows.half + 1) - 1
    given = np.concatenate([np.full((len(WAYS), 1), mass), WAYS * mass * span], axis=1)
    inputs = np.broadcast_to(given[:, None, None], (len(WAYS), *follower.windows.shape, 3))
    shift, seen = follower(inputs)
    outputs = np.concatenate([shift, seen[..., None]], axis=-1)
    here = replace(follower, windows=replace(follower.windows, loadable=False)).bound
    note = "the bound is of any places that can be loaded" if follower.loadable else ""
    return WorstCase(
        *("shifts of dots", "shift", follower.width, follower.bound, here),
        *(magnitude(shift), follower, inputs, outputs, note),
    )


def reachable(spread: DotSpread) -> dict[str, int]:
    """The largest magnitudes of A, B, C and of the spread, of these places and shifts up to the limit.

    Each of A, B and C is largest with all dots in contact. A is then half the sum of all squared differences
    of two shifts, B a sum of shifts with weights, and C depends on the places alone.
    """
    n, limit = len(spread.place), spread.shift_limit
    found = spread.sums(np.zeros((n, 2), np.int64), np.ones(n, bool))
    return {
        "A": 2 * limit**2 * (n**2 - n % 2),
        "B": replace(spread, side=None).bounds["B"],
        "C": int(found["C"]),
        "spread": 2 * limit**2,
    }


def alternating(spread: DotSpread) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (frames, M, 2) of largest magnitude of which as many point one way as the other, and contacts
    (frames, M): of all dots, and of all but one where their number is odd."""
    rng, n = np.random.default_rng(1), len(spread.place)
    signs = np.array([rng.permutation(np.arange(n) % 2) for _ in range(PATTERNS)])
    shifts = spread.shift_limit * (1 - 2 * np.stack([signs, signs], axis=-1))
    contact = np.ones((PATTERNS, n), bool)
    if n % 2 and n > 1:
        # Of the odd number, one more is shifted by +limit: the first of those is left out.
        contact[np.arange(PATTERNS), signs.argmin(axis=1)] = np.arange(PATTERNS) % 2 == 0
    return shifts, contact


def spread_cases(spread: DotSpread) -> list[WorstCase]:
    """A, B, C and the spread: shifts that turn about the middle, and the best of many that alternate."""
    n, limit = len(spread.place), spread.shift_limit
    arms = n * spread.xy - spread.xy.sum(axis=0)
    turning = limit * np.where(arms[:, ::-1] * (-1, 1) > 0, 1, -1)
    shifts, contact = alternating(spread)
    shifts = np.concatenate([[turning, -turning], shifts])
    contact = np.concatenate([np.ones((2, n), bool), contact])
    found = spread.sums(shifts, contact)
    found["spread"] = spread.ratio(found)
    kept = [0, 1, *{int(np.abs(found[name]).argmax()) for name in ("A", "spread")}]
    inputs = np.stack([found[name][kept] for name in sums_layout(spread).members], axis=-1)
    outputs = np.stack([found["spread"][kept], found["n"][kept]], axis=-1)
    widest, bounds = reachable(spread), spread.bounds
    notes = dict.fromkeys(widest, "")
    if spread.side:
        notes |= dict.fromkeys("BC", "the bound is of any places that can be loaded")
    return [
        WorstCase(
            *("spread of dots", word, signed_width(bounds[word]), bounds[word], widest[word]),
            *(magnitude(found[word][kept]), spread, inputs, outputs, note),
        )
        for word, note in notes.items()
    ]


def of_dots(pipeline: IntegerPipeline) -> list[WorstCase]:
    """Worst cases of the stages that follow the dots, and of their spread; none without such stages."""
    found = []
    if pipeline.follower is not None:
        found += [*window_cases(pipeline.follower.windows), shift_case(pipeline.follower)]
    if pipeline.spread is not None:
        found += spread_cases(pipeline.spread)
    return found
