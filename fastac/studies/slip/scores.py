"""How well a quantity tells contacts of which most nodes slide from those of which most stick."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import mannwhitneyu, spearmanr

LEAST_STEPS = 5
"""Steps that a drag must have for a rank correlation."""


def area_under_curve(values: np.ndarray, slips: np.ndarray) -> float | None:
    """Area under the ROC curve of values (n,), which are to be larger where `slips`, (n,) bool.

    It is the probability that a value of the first kind exceeds one of the second. None without both kinds.
    """
    if slips.all() or not slips.any():
        return None
    pairs = int(slips.sum()) * int((~slips).sum())
    return float(mannwhitneyu(values[slips], values[~slips]).statistic / pairs)


def rank_correlation(drags: Sequence[tuple[np.ndarray, np.ndarray]]) -> float | None:
    """Spearman's correlation of values and shares of sliding nodes, (n,) each of a drag; mean over drags.

    Drags of fewer than LEAST_STEPS steps, or of equal values or shares, do not count; None without any.
    """
    found = [
        spearmanr(values, sliding).statistic
        for values, sliding in drags
        if len(values) >= LEAST_STEPS and np.ptp(values) > 0 and np.ptp(sliding) > 0
    ]
    return float(np.mean(found)) if found else None


def mean_at(level: float, drags: Sequence[tuple[np.ndarray, np.ndarray]]) -> float | None:
    """Mean over drags of the value at which a share `level` slides, interpolated between a drag's steps.

    drags : values and shares of sliding nodes, (n,) each; those that do not pass the level do not count
    """
    found = []
    for values, sliding in drags:
        order = np.argsort(sliding, kind="stable")
        if len(order) and sliding[order[0]] <= level <= sliding[order[-1]]:
            found.append(np.interp(level, sliding[order], values[order]))
    return float(np.mean(found)) if found else None


def rates(flagged: np.ndarray, slips: np.ndarray) -> dict[str, float | None]:
    """Shares of the slipping and of the other states that are flagged, (n,) bool each."""
    return {
        name: float(flagged[kind].mean()) if kind.any() else None
        for name, kind in (("hit", slips), ("false_alarm", ~slips))
    }


def best_limit(values: np.ndarray, slips: np.ndarray) -> float | None:
    """The limit that values (n,) exceed most often where `slips`, (n,) bool, and most rarely elsewhere.

    Of the limits halfway between two values it has the largest balanced accuracy, (hit rate + 1 − false-alarm
    rate) / 2; it is the lowest of equals. None without both kinds, or with one value only.
    """
    known = np.unique(values)
    if slips.all() or not slips.any() or len(known) < 2:
        return None
    limits = (known[1:] + known[:-1]) / 2
    beyond = values > limits[:, None]
    balance = beyond[:, slips].mean(axis=1) - beyond[:, ~slips].mean(axis=1)
    return float(limits[balance.argmax()])
