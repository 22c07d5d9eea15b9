"""Ridge regression of forces on any features: one solution, without start, steps or seed.

The regularisation is the one of the smallest error on frames that were not fitted: those of the validation
split or, without one, every fifth training frame.
Source: Hastie et al., "The Elements of Statistical Learning", 2nd ed., section 3.4.1.
"""

import numpy as np

REGULARISATION = 10.0 ** np.arange(-9, 1, 0.5)
"""Tried, relative to the mean eigenvalue of the frames' inner products."""
HELD_OUT = 5
"""Where there is no validation split every so many training frames one is held out for the choice."""


def solve(x: np.ndarray, force_n: np.ndarray, regularisation: np.ndarray) -> np.ndarray:
    """Ridge weights (regularisations, features, axes) of x (frames, features), each scaled to its own spread.

    One singular value decomposition serves all strengths of the regularisation.
    """
    x = x.astype(np.float64)
    spread = np.sqrt((x**2).mean(axis=0))
    spread = np.where(spread > 0, spread, 1)
    u, s, vh = np.linalg.svd(x / spread, full_matrices=False)
    power = (s**2).sum() / len(x)
    damped = s / (s**2 + np.maximum(regularisation[:, None] * power, np.finfo(float).tiny))
    return vh.T @ (damped[..., None] * (u.T @ force_n)) / spread[:, None]


def validation_errors(x: dict[str, np.ndarray], force_n: dict[str, np.ndarray]) -> list[dict]:
    """The error of every regularisation on unseen frames; x (frames, features) and force_n by split name.

    Raises ValueError where there are too few frames to hold any out, or no force to learn.
    """
    if "validation" not in x and len(x["train"]) < HELD_OUT:
        raise ValueError(f"split: {len(x['train'])} training frames without validation: expected {HELD_OUT}")
    if not np.abs(force_n["train"]).max():
        raise ValueError("force_n: zero in every training frame: expected some force to learn")
    return _try_all(x, force_n)[0]


def best_weights(x: dict[str, np.ndarray], force_n: dict[str, np.ndarray]) -> tuple[np.ndarray, list[dict]]:
    """The weights (features, axes) of the best attempt, and all `validation_errors`; with a validation split one
    decomposition serves both."""
    history, weights = _try_all(x, force_n)
    if "validation" in x:
        return weights[history.index(best(history))], history
    return fit(x["train"], force_n["train"], best(history)), history


def _try_all(x, force_n) -> tuple[list[dict], np.ndarray]:
    """The validation_errors, and the weights of each, from the frames that were not held out."""
    if "validation" in x:
        seen, unseen = (x["train"], force_n["train"]), (x["validation"], force_n["validation"])
    else:
        held = np.arange(len(x["train"])) % HELD_OUT == HELD_OUT - 1
        seen, unseen = ((x["train"][part], force_n["train"][part]) for part in (~held, held))
    found = solve(*seen, REGULARISATION)
    history = [
        {
            "regularisation": float(regularisation),
            "validation_mae_n": float(np.abs(unseen[0] @ weights - unseen[1]).sum(axis=1).mean()),
        }
        for regularisation, weights in zip(REGULARISATION, found, strict=True)
    ]
    return history, found


def best(history: list[dict]) -> dict:
    """The attempt of the smallest error."""
    return min(history, key=lambda entry: entry["validation_mae_n"])


def fit(x: np.ndarray, force_n: np.ndarray, attempt: dict) -> np.ndarray:
    """Weights (features, axes) from all of x (frames, features), as `attempt` says."""
    return solve(x, force_n, np.array([attempt["regularisation"]]))[0]
