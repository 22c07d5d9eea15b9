"""Conformal prediction: how wide intervals must be that hold a given share of the values of new groups.

Scores are errors in units of a scale that is known for each frame, |error| / scale. Of K groups that are as
good as exchangeable with new ones (recordings, objects or presses; frames of one group are not), each has the
same weight, however many frames it has, and a new one counts as a group whose scores are infinite:

    q = the smallest score with (K + 1)⁻¹ · Σ_k (share of group k's scores ≤ q) ≥ coverage

Then a frame of a new group has |error| ≤ q · scale with at least that probability, whatever the scale is.
Sources: R. Dunn, L. Wasserman, A. Ramdas, Distribution-Free Prediction Sets for Two-Layer Hierarchical
Models, JASA 2022 (pooled distributions of groups); Y. Lee, R. F. Barber, R. Willett, Distribution-Free
Inference with Hierarchical Data, 2023 (its correction for a finite number of groups).
"""

import math

import numpy as np
from scipy.optimize import nnls

PASSES = 3
"""Fits of the scale; each weighs frames by the scale that the one before found."""
LEAST_SHARE = 0.2
"""Of the mean error: the least constant part of a scale, so that none is close to 0."""
LEAST = 1e-9


def supported(groups: int) -> float:
    """The largest coverage for which so many groups give finite intervals."""
    return groups / (groups + 1)


def group_weights(groups: np.ndarray) -> np.ndarray:
    """Weights (frames,) that sum to 1, with which each group weighs the same; groups (frames,) integers."""
    _, place, count = np.unique(groups, return_inverse=True, return_counts=True)
    return 1 / (len(count) * count[place])


def pooled_quantile(scores: np.ndarray, groups: np.ndarray, coverage: float) -> float:
    """q of the module's docstring, for scores (frames,) of groups (frames,).

    Raises ValueError where there are too few groups for the coverage, `supported`.
    """
    count = len(np.unique(groups))
    # The share of one group more, whose scores are infinite; a rounding error must not ask for more.
    needed = coverage * (count + 1) / count * (1 - 1e-12)
    if needed > 1:
        raise ValueError(f"coverage {coverage}: {count} groups support at most {supported(count):.4g}")
    order = np.argsort(scores, kind="stable")
    reached = np.cumsum(group_weights(groups)[order])
    reached[-1] = 1.0
    return float(scores[order][np.searchsorted(reached, needed * (1 - 1e-12))])


def linear_scale(
    magnitudes: np.ndarray, errors: np.ndarray, weights: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """The mean |error| as base + magnitudes @ weights, none of them negative: base and weights (K,).

    magnitudes : (frames, K), 0 or more; errors : (frames,) |error|; weights : (frames,) of the frames
    """
    weights = np.full(len(errors), 1 / len(errors)) if weights is None else weights / weights.sum()
    mean = max(float(weights @ errors), LEAST)
    spans = np.maximum(magnitudes.max(axis=0, initial=0), 1)
    terms = np.column_stack([np.ones(len(errors)), magnitudes / spans])
    least, scale = LEAST_SHARE * mean, np.full(len(errors), mean)
    for _ in range(PASSES):
        root = np.sqrt(weights) / scale
        # Of what the constant part must have at least, the rest is fitted.
        found, _ = nnls(terms * root[:, None], (errors - least) * root)
        scale = least + terms @ found
    return least + float(found[0]), found[1:] / spans


def wilson(share: float, count: float, deviations: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share that `count` independent trials have shown; 1.96: of 95%."""
    middle = share + deviations**2 / (2 * count)
    half = deviations * math.sqrt(share * (1 - share) / count + deviations**2 / (4 * count**2))
    whole = 1 + deviations**2 / count
    return max((middle - half) / whole, 0.0), min((middle + half) / whole, 1.0)
