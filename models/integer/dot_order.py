"""The dots of a gel in the order of another one's: what is known of each dot goes with its place in a row."""

from dataclasses import replace

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower


def order_like(follower: DotFollower, known: DotFollower, limit_px: float) -> np.ndarray:
    """The index of the dot that is at each of the known follower's places, (M,).

    Each dot is that of the known place nearest to it. Raises ValueError, one line, unless that makes pairs of
    all dots, none farther apart than `limit_px`.
    """
    count, known_count = len(follower.rest), len(known.rest)
    if count != known_count:
        raise ValueError(f"follower.rest: {count} dots: the hardware follows {known_count}")
    apart = np.linalg.norm((known.rest[:, None] - follower.rest) * 2.0**-FRACTION, axis=-1)
    place = apart.argmin(axis=0)
    far = np.flatnonzero(apart.min(axis=0) > limit_px)
    if len(far):
        u, v = follower.rest_px[far[0]]
        raise ValueError(f"dot at {u}, {v} px: the hardware follows none within {limit_px:g} px")
    alone = np.setdiff1d(np.arange(count), place)
    if len(alone):
        u, v = known.rest_px[alone[0]]
        raise ValueError(f"dot at {u}, {v} px: followed by the hardware, and nearest to none of the new dots")
    return place.argsort()


def in_order(follower: DotFollower, order: np.ndarray, known: DotFollower) -> DotFollower:
    """`follower` with its dots in `order` (M,), which is that of `known`, and with the guides of that."""
    parts = {name: getattr(follower, name)[order] for name in ("rest", "low", "high")}
    return replace(follower, **parts, guides=known.guides)
