"""The spread of marker dots about the rigid motion that fits them best, in floating point."""

import numpy as np

from fastac.models.integer.dot_spread import LEAST_DOTS


def rigid_spread_px(place_px: np.ndarray, shift_px: np.ndarray) -> float:
    """Root mean square in px of what a translation and a small rotation leave of shifts (n, 2) at places
    (n, 2); 0 for fewer than LEAST_DOTS dots, which have no spread.

    The float counterpart of `models.integer.dot_spread.DotSpread`, which says more.
    """
    if len(place_px) < LEAST_DOTS:
        return 0.0
    arm, rest = place_px - place_px.mean(axis=0), shift_px - shift_px.mean(axis=0)
    across = np.stack([-arm[:, 1], arm[:, 0]], axis=-1)
    rest = rest - across * (across * rest).sum() / (arm**2).sum()
    return float(np.sqrt((rest**2).sum() / len(rest)))
