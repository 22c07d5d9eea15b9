"""Errors of ridge regressions on frames that they were not fitted to: those of other recordings.

Frames of one recording are alike. A model of some hundred weights that was fitted to some of them explains
the others, too, and says nothing of another object. So each recording is left out once, and errors on what
was left out choose the model's size and the strength of its regularisation.

With few features each fit is made from the sums over the other parts' frames. With many, one fit to all
frames says what the fits without a part would find: for the part's rows X_k and the fit's matrix
H = X (XᵀX + λI)⁻¹ Xᵀ the errors without it are (I − H_kk)⁻¹ times those of the fit.
Sources: Hastie et al., "The Elements of Statistical Learning", 2nd ed., section 7.10; Allen, "The
Relationship between Variable Selection and Data Augmentation and a Method for Prediction", 1974, whose single
frames are parts here.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, solve

from fastac.models.training.force import ridge, robust_ridge

PARTS = 8
"""Into at most so many parts recordings are divided, of which each is left out once."""
MANY = 2
"""From more features than this multiple of a part's frames on, a single fit takes less time than all."""


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
    x = x.astype(np.float64) / ridge.root_mean_squares(x)
    found = np.zeros(len(regularisation))
    for values in force_n.T:
        error = _errors_n(x, values, regularisation, np.ones(len(x)), parts) @ weight
        if robust and values.any():
            _, share = robust_ridge.reweighted(x, values, regularisation[error.argmin()])
            error = _errors_n(x, values, regularisation, share, parts) @ weight
        found += error
    return found


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
    many = x.shape[1] > MANY * max(map(len, parts))
    return (_from_one_fit if many else _from_all_fits)(x, force_n, regularisation, share, parts)


def _from_all_fits(x, force_n, regularisation, share, parts) -> np.ndarray:
    """`_errors_n` by each fit itself."""
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


def _from_one_fit(x, force_n, regularisation, share, parts) -> np.ndarray:
    """`_errors_n` by a single decomposition."""
    root = np.sqrt(share)
    powers, x = _principal(x * root[:, None])
    force_n = force_n * root
    moment = x.T @ force_n
    found = np.empty((len(regularisation), len(x)))
    for part in parts:
        own = x[part]
        others = powers.sum() - np.square(own).sum()
        for k, strength in enumerate(regularisation):
            penalty = max(strength / (len(x) - len(part)), robust_ridge.LEAST_PENALTY) * others
            damping = 1 / np.sqrt(powers + (penalty or 1.0))
            damped = own * damping
            error = damped @ (damping * moment) - force_n[part]
            without = solve(np.eye(len(part)) - damped @ damped.T, error, assume_a="sym")
            found[k, part] = np.abs(without) / root[part]
    return found


def _principal(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (n,) of xᵀx and x (frames, n) turned to its eigenvectors; ridge regressions on what is
    turned give the same forces. The eigenvectors of the smaller of xᵀx and xxᵀ are found."""
    frames, features = x.shape
    if features <= frames:
        powers, vectors = eigh(x.T @ x)
        return np.maximum(powers, 0), x @ vectors
    powers, vectors = eigh(x @ x.T)
    powers = np.maximum(powers, 0)
    return powers, vectors * np.sqrt(powers)
