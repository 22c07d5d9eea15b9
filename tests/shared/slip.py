"""Dots, displacements and what they are as payloads, for tests of slip in hardware."""

import numpy as np

from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread

BITS, THRESHOLD = 8, 20
"""Bits of a displacement, and the threshold of contact."""


def displacement_beats(displacement: np.ndarray, lanes: int, *, rows_reversed: bool) -> list[int]:
    """Displacements (frames, N, N) as payloads; the lanes beyond a row hold what is no displacement."""
    void = -displacement.shape[-1] % lanes
    padded = np.pad(displacement, ((0, 0), (0, 0), (0, void)), constant_values=(1 << (BITS - 1)) - 1)
    if rows_reversed:
        padded = padded[:, ::-1]
    mask = (1 << BITS) - 1
    return [
        sum((int(value) & mask) << (BITS * k) for k, value in enumerate(beat))
        for beat in padded.reshape(-1, lanes)
    ]


def situations(follower: DotFollower, spread: DotSpread, frames: int) -> tuple[np.ndarray, ...]:
    """Shifts (frames, M, 2), which dots are seen (frames, M), and displacements (frames, N, N).

    The first: nothing touches; all dots touch and shift as far as they can, outwards, and around; all are
    lost; one on, one off. Then random ones.
    """
    rng, count = np.random.default_rng(1), len(spread.place)
    height, width = follower.windows.image
    limit, top = spread.shift_limit, (1 << (BITS - 1)) - 1
    shift = rng.integers(-limit, limit + 1, (frames, count, 2))
    seen = rng.random((frames, count)) < 0.9
    displacement = rng.integers(-top, top + 1, (frames, height - 2, width - 2))
    outwards = np.where(spread.xy < 0, -limit, limit)
    displacement[0] = spread.threshold
    shift[1], shift[2] = outwards, outwards[:, ::-1] * [-1, 1]
    displacement[1:3], seen[1:3] = top, True
    seen[3] = False
    displacement[4] = np.where(np.indices(displacement[4].shape).sum(axis=0) % 2, top, -top)
    return shift, seen, displacement
