"""Ridge regression that a few wrong forces do not lead astray.

A gauge that is pulled while the gripper opens, or that lags behind the camera, gives forces that the skin
never felt. Squares of such errors would outweigh thousands of right frames. Huber's loss counts errors that
are large, beside those of most frames, by their magnitude instead.
Source: Huber, "Robust Estimation of a Location Parameter", 1964; Holland, Welsch, "Robust Regression Using
Iteratively Reweighted Least-Squares", 1977.
"""

import numpy as np
from scipy.linalg import solve

from fastac.models.training.force import ridge

TUNING = 1.345
"""Standard deviations beyond which an error counts by its magnitude. Where errors are normal, a twentieth of
the frames' information is lost."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution whose median magnitude is 1."""
ITERATIONS = 8
SMALLEST = 1e-9
"""Share of the largest force below which no error counts by its magnitude: where all is exact, none does."""
LEAST_PENALTY = 1e-12
"""Share of the Gram matrix's trace: less would be lost beside its rounding."""


def fit(x: np.ndarray, force_n: np.ndarray, attempt: dict) -> np.ndarray:
    """Weights (features, axes) of x (frames, features) for force_n (frames, axes) in N, with the
    regularisation of `attempt`, as `ridge.fit` but with Huber's loss.

    Each axis has outliers of its own.
    """
    x = x.astype(np.float64)
    scale = ridge.root_mean_squares(x)
    x /= scale
    found = [reweighted(x, values, attempt["regularisation"])[0] for values in force_n.T]
    return np.stack(found, axis=1) / scale[:, None]


def reweighted(x: np.ndarray, force_n: np.ndarray, regularisation: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights (features,) of scaled features (frames, features) for the forces (frames,) of one axis, and by
    how much each frame's square counts, (frames,), from 0 to 1."""
    share, smallest_n = np.ones(len(x)), max(SMALLEST * np.abs(force_n).max(), np.finfo(float).tiny)
    for _ in range(ITERATIONS):
        found = _weighted(x, force_n, share, regularisation)
        error_n = np.abs(x @ found - force_n)
        limit_n = max(TUNING * NORMAL * np.median(error_n), smallest_n)
        share = limit_n / np.maximum(error_n, limit_n)
    return found, share


def _weighted(x: np.ndarray, force_n: np.ndarray, share: np.ndarray, regularisation: float) -> np.ndarray:
    """The ridge regression in which each frame's square counts by its share; the regularisation is relative
    to the weighted frames' power, as in `ridge.solve`."""
    root = np.sqrt(share)
    weighted = x * root[:, None]
    gram = weighted.T @ weighted  # of one array with itself: in half the time
    return penalised(gram, weighted.T @ (force_n * root), regularisation * np.trace(gram) / len(x))


def penalised(gram: np.ndarray, moment: np.ndarray, penalty: float) -> np.ndarray:
    """Weights (features,) of a ridge regression, from the frames' Gram matrix (features, features) and their
    features' products with the force, (features,)."""
    penalty = max(penalty, LEAST_PENALTY * np.trace(gram))
    damped = gram.copy()
    damped[np.diag_indices_from(damped)] += penalty or 1.0  # without any power there is no force to explain
    return solve(damped, moment, assume_a="pos")
