"""A force that bends in the displacement, segment by segment: a slope for each, where `terms` has weights.

Between two bends Σ_t w_t · x_t of `integer.force.terms` is a straight line in the displacement: one product
of the displacement with the segment's slope, and an offset that follows from the slopes and the bends.
"""

import numpy as np

from fastac.models.integer.force import terms


def segment_slopes(weight: np.ndarray) -> np.ndarray:
    """Slopes (..., segments) of the weights (..., terms) of `integer.force.terms`, one for each term: within
    the band, beyond it towards the camera, beyond it away from the camera, and deeper than each further bend.
    """
    inside, towards, away = weight[..., 0], weight[..., 0] + weight[..., 1], weight[..., 0] + weight[..., 2]
    deeper = towards[..., None] + np.cumsum(weight[..., 3:], axis=-1)
    return np.concatenate([np.stack([inside, towards, away], axis=-1), deeper], axis=-1)


def places_of_extremes(bends: tuple[int, ...], limit: int) -> np.ndarray:
    """Displacements of ±limit among which Σ_t w_t · x_t is largest and smallest, whatever the weights: a line
    of straight segments is so at the bends, at the ends and, as for no displacement at all, at 0."""
    known = {-limit, -bends[0], 0, *bends, limit}
    return np.array(sorted(place for place in known if abs(place) <= limit))


def largest(weight: np.ndarray, bends: tuple[int, ...], limit: int) -> np.ndarray:
    """Largest magnitude (...) of Σ_t w_t · x_t over all displacements of ±limit, for weights (..., terms)."""
    return np.abs(weight @ terms(places_of_extremes(bends, limit), bends).T).max(axis=-1)
