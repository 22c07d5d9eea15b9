"""Whether a recording's frames show a force at another time than its gauge read it.

Cameras buffer frames, gauges filter readings, and clocks differ. Then each frame has the force of another
one, which no model can learn. The harder a skin is pressed, the more its image differs from that of the skin
at rest: where this difference follows the force far better after a shift by some frames, they are apart.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

MOST_FRAMES = 15
"""The largest delay that is looked for."""
SHORTEST = 2 * MOST_FRAMES
"""Recordings of fewer frames say nothing."""
LEAST_CORRELATION, LEAST_GAIN = 0.7, 0.2
"""Of a delay that is believed: the correlation with it, and how much larger it is than without."""


class Delay(NamedTuple):
    """The frames of a recording are `frames` later than its forces, earlier if negative."""

    recording: str
    frames: int
    correlation: float
    """Between the images' difference from rest and the force, with the delay taken away."""
    without: float
    """As they are."""


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a, b)[0, 1]) if a.std() > 0 and b.std() > 0 else 0.0


def delay(recording: str, change: np.ndarray, force_n: np.ndarray) -> Delay | None:
    """The delay of one recording, None where it has none that is believed.

    change : (frames,) how much each frame differs from rest; force_n : (frames,) along z, in order of time
    """
    count = len(change)
    if count < SHORTEST:
        return None
    found = {
        late: _correlation(
            change[max(late, 0) : count + min(late, 0)], force_n[max(-late, 0) : count - max(late, 0)]
        )
        for late in range(-MOST_FRAMES, MOST_FRAMES + 1)
    }
    best = max(found, key=found.get)
    if found[best] < LEAST_CORRELATION or found[best] < found[0] + LEAST_GAIN:
        return None
    return Delay(recording, best, found[best], found[0])


def delays(recordings: Sequence[str], change: np.ndarray, force_n: np.ndarray) -> tuple[Delay, ...]:
    """The recordings with a `delay`; of all frames, which recording each is of, its change and its force."""
    names = np.array(recordings)
    found = [delay(name, change[names == name], force_n[names == name]) for name in dict.fromkeys(recordings)]
    return tuple(one for one in found if one is not None)
