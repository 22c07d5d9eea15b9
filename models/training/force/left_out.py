"""Errors of ridge regressions on frames that they were not fitted to: those of other recordings.

Frames of one recording are alike. A model of some hundred weights that was fitted to some of them explains
the others, too, and says nothing of another object. So each recording is left out once, and errors on what
was left out choose the model's size and the strength of its regularisation.
Source: Hastie et al., "The Elements of Statistical Learning", 2nd ed., section 7.10.
"""

from typing import NamedTuple

import numpy as np

from fastac.models.training.force import ridge, robust_ridge

PARTS = 8
"""Into at most so many parts recordings are divided, of which each is left out once."""


class _Products(NamedTuple):
    """What ridge regressions without a part are made of: each part's own sums over its frames."""

    gram: np.ndarray
    """Σ share · x xᵀ, (parts, n, n)."""
    moment: np.ndarray
    """Σ share · x · force, (parts, n)."""


def errors_n(
    x: np.ndarray,
    force_n: np.ndarray,
    recording: np.ndarray,
    regularisation: np.ndarray = ridge.REGULARISATION,
    *,
    robust: bool = False,
) -> np.ndarray:
    """Mean absolute errors in N on recordings left out, of each regularisation, (regularisations,).

    Recordings count alike in the mean, and the axes' errors are added.

    x : (frames, features); force_n : (frames, axes); recording : (frames,), of at least two recordings
    robust : whether Huber's loss is minimised. Which forces are wrong is found once, in the fit to all
        frames with the strength that is best for squares, for it hardly changes from fit to fit.
    """
    names, code = np.unique(recording, return_inverse=True)
    if len(names) < 2:
        raise ValueError(f"recording = {names.tolist()}: expected at least two to leave one out")
    part = code % min(len(names), PARTS)
    parts = [np.flatnonzero(part == k) for k in range(part.max() + 1)]
    weight = 1 / (len(names) * np.bincount(code)[code])
    x = _narrow(x / ridge.root_mean_squares(x))
    found = np.zeros(len(regularisation))
    for values in force_n.T:
        error = _errors_n(x, values, regularisation, np.ones(len(x)), parts) @ weight
        if robust and values.any():
            _, share = robust_ridge.reweighted(x, values, regularisation[error.argmin()])
            error = _errors_n(x, values, regularisation, share, parts) @ weight
        found += error
    return found


def _narrow(x: np.ndarray) -> np.ndarray:
    """x (frames, features) turned such that it has no more features than frames; all ridge regressions on
    some of its frames give the others the same forces."""
    x = x.astype(np.float64)
    if x.shape[1] <= x.shape[0]:
        return x
    u, s, _ = np.linalg.svd(x, full_matrices=False)
    return u * s


def _products(x: np.ndarray, force_n: np.ndarray, share: np.ndarray, parts: list[np.ndarray]) -> _Products:
    weighted = [x[part] * share[part, None] for part in parts]
    return _Products(
        np.stack([x[part].T @ own for part, own in zip(parts, weighted, strict=True)]),
        np.stack([own.T @ force_n[part] for part, own in zip(parts, weighted, strict=True)]),
    )


def _errors_n(
    x: np.ndarray,
    force_n: np.ndarray,
    regularisation: np.ndarray,
    share: np.ndarray,
    parts: list[np.ndarray],
) -> np.ndarray:
    """Absolute errors (regularisations, frames) on each part, of fits to the others."""
    products = _products(x, force_n, share, parts)
    gram, moment = (values.sum(axis=0) for values in products)
    found = np.empty((len(regularisation), len(x)))
    for part, own_gram, own_moment in zip(parts, *products, strict=True):
        others = gram - own_gram
        power = np.trace(others) / (len(x) - len(part))
        for k, strength in enumerate(regularisation):
            weights = robust_ridge.penalised(others, moment - own_moment, strength * power)
            found[k, part] = np.abs(x[part] @ weights - force_n[part])
    return found
