"""Which candidate is chosen, and what that choice is worth on data that had no say in it: nested
cross-validation with two folds left out together.

A training without the folds {j, k} is judged on j and on k. To choose for the outer fold k, only the errors
on j of trainings without k count, so fold k has no part in it; each training serves two outer folds.
Candidates are compared on few pairs of folds first, and the best of each outer fold on all of them
(successive halving: Jamieson, Talwalkar, "Non-stochastic Best Arm Identification and Hyperparameter
Optimization", 2016). A last training of each outer fold's winner, without k alone, gives the nested error on
k (Varma, Simon, "Bias in error estimation when using cross-validation for model selection", 2006).
"""

from collections.abc import Iterable, Mapping
from itertools import combinations

import numpy as np

Pair = tuple[int, int]
Errors = Mapping[tuple[int, Pair], Mapping[int, float]]
"""By candidate and pair of folds left out: the error on each of the two folds; infinite where it failed."""
KEPT_SHARE = 3
"""Of the candidates of a rung, one in so many goes on, at least two; for each outer fold."""


def pairs(folds: int) -> list[list[Pair]]:
    """The pairs of folds, rung by rung: first neighbours on a circle, which have each fold twice, then the
    rest."""
    every = list(combinations(range(folds), 2))
    near = [pair for pair in every if pair[1] - pair[0] in (1, folds - 1)]
    return [near, rest] if (rest := [pair for pair in every if pair not in near]) else [near]


def inner(errors: Errors, candidate: int, outer: int | None, used: Iterable[Pair]) -> np.ndarray:
    """The errors that count for an outer fold: on the other fold of each used pair with it; None: all."""
    found = []
    for pair in used:
        known = errors[candidate, pair]
        if outer is None:
            found += [known[fold] for fold in pair]
        elif outer in pair:
            found.append(known[pair[0] if pair[1] == outer else pair[1]])
    return np.array(found)


def ranked(errors: Errors, those: Iterable[int], outer: int | None, used: Iterable[Pair]) -> list[int]:
    """The candidates by their mean error for an outer fold, the least first; of equal ones the earlier."""
    used = list(used)
    return sorted(those, key=lambda c: (inner(errors, c, outer, used).mean(), c))


def survivors(errors: Errors, those: Iterable[int], folds: int, used: Iterable[Pair]) -> set[int]:
    """The candidates that go on: for each outer fold, and for the choice on all, the best of `those`."""
    those, used = list(those), list(used)
    count = max(2, -(-len(those) // KEPT_SHARE))
    kept = set()
    for outer in (None, *range(folds)):
        kept |= set(ranked(errors, those, outer, used)[:count])
    return kept


def indistinguishable(errors: Errors, those: Iterable[int], used: Iterable[Pair]) -> list[int]:
    """The candidates whose mean error is within one standard error of the best one's, the best included.

    The standard error is of the differences from the best, pair by pair. Folds are shared between pairs, so
    that it is a lower limit.
    """
    used = list(used)
    best, *others = ranked(errors, those, None, used)
    found = [best]
    for other in others:
        theirs = inner(errors, other, None, used)
        if not np.isfinite(theirs).all():  # it failed
            continue
        difference = theirs - inner(errors, best, None, used)
        if difference.mean() <= difference.std(ddof=1) / len(difference) ** 0.5:
            found.append(other)
    return found


def mean(metrics: Iterable[Mapping[str, float]], name: str) -> float:
    """The mean error over the units in which it is known: presses whose contact reaches beyond the photograph
    have none of the depth."""
    return float(np.mean([each[name] for each in metrics if name in each]))


def score(metrics: Iterable[Mapping[str, float]], names: Iterable[str]) -> float:
    """One number for the errors of several units: the geometric mean, over the named metrics, of each one's
    `mean` over the units."""
    metrics = list(metrics)
    means = [mean(metrics, name) for name in names]
    return float(np.exp(np.mean(np.log(np.maximum(means, np.finfo(float).tiny)))))
