"""Ridge regression of forces on features, in closed form, with the regularisation chosen by validation.

The regularisation is chosen by the errors on held-out frames (`held_out_errors`): `best` has the smallest
error, `strongest` is as good within chance.
Source: Hastie et al., "The Elements of Statistical Learning", 2nd ed., sections 3.4.1 and 7.10.
"""

import numpy as np

REGULARISATION = 10.0 ** np.arange(-9, 1, 0.5)
"""Strengths that are tried, relative to the mean eigenvalue of the frames' Gram matrix."""
LARGEST_SVD = 1024
"""Rank up to which a singular value decomposition is used. Beyond, the eigenvectors of the Gram matrix take a
quarter of the time, and what its squared condition loses, 1e-16 of the largest eigenvalue, is little beside
the weakest regularisation."""
HELD_OUT = 5
"""Without a validation split and without groups, one of this many training frames is held out to choose the
regularisation."""
FOLDS = 10
"""Into so many parts groups of frames are divided for `cross_validation_errors`."""
FEWEST_GROUPS = 5
"""Groups of frames from which on they can be held out in turn."""


def solve(x: np.ndarray, force_n: np.ndarray, regularisation: np.ndarray) -> np.ndarray:
    """Ridge weights (regularisations, features, axes) of x (frames, features) for force_n (frames, axes) in
    N.

    Each feature is scaled to a root mean square of 1 for the penalty. One decomposition serves all
    regularisation strengths.
    """
    x = x.astype(np.float64)
    spread = root_mean_squares(x)
    if min(x.shape) > LARGEST_SVD:
        return _by_eigenvectors(x / spread, force_n, regularisation) / spread[:, None]
    u, s, vh = np.linalg.svd(x / spread, full_matrices=False)
    power = (s**2).sum() / len(x)
    damped = s / (s**2 + np.maximum(regularisation[:, None] * power, np.finfo(float).tiny))
    return vh.T @ (damped[..., None] * (u.T @ force_n)) / spread[:, None]


def root_mean_squares(x: np.ndarray) -> np.ndarray:
    """Of each feature of x (frames, features), (features,); 1 where it is zero in all frames."""
    spread = np.sqrt((x**2).mean(axis=0))
    return np.where(spread > 0, spread, 1)


def _by_eigenvectors(x: np.ndarray, force_n: np.ndarray, regularisation: np.ndarray) -> np.ndarray:
    """`solve` for scaled features, by the eigenvectors of the smaller of their two Gram matrices."""
    frames, features = x.shape
    wide = features > frames
    values, vectors = np.linalg.eigh(x @ x.T if wide else x.T @ x)
    values = np.maximum(values, 0)
    damped = 1 / (
        values + np.maximum(regularisation[:, None] * (values.sum() / frames), np.finfo(float).tiny)
    )
    found = vectors @ (damped[..., None] * (vectors.T @ (force_n if wide else x.T @ force_n)))
    return x.T @ found if wide else found


def check(force_n: dict[str, np.ndarray]) -> None:
    """Raise ValueError where too few frames leave none to hold out, or all forces (frames, axes) are zero."""
    count = len(force_n["train"])
    if "validation" not in force_n and count < HELD_OUT:
        raise ValueError(f"split: {count} training frames without validation: expected {HELD_OUT}")
    if not np.abs(force_n["train"]).max():
        raise ValueError("force_n: zero in every training frame: expected some force to learn")


def validation_errors(x: dict[str, np.ndarray], force_n: dict[str, np.ndarray]) -> list[dict]:
    """The error of every regularisation on the frames of the validation split or, without one, on every fifth
    training frame, as [{"regularisation": …, "validation_mae_n": …, "standard_error_n": …}]; the last is the
    standard error of the difference from the smallest one.

    x (frames, features) and force_n (frames, axes) by split name. The forces of some axes may be zero in
    every frame. Call `check` first.
    """
    return _try_all(x, force_n)[0]


def held_out_errors(
    x: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    together: dict[str, np.ndarray] | None = None,
    *,
    with_validation: bool = False,
) -> list[dict]:
    """The errors that choose a regularisation: `cross_validation_errors` where the validation split will be
    fitted as well (with_validation) or is missing, else `validation_errors`.

    together : as in `cross_validation_errors`; without it, or with fewer than FEWEST_GROUPS groups that have
        some force, the errors are `validation_errors` all the same
    """
    if together is None or not (with_validation or "validation" not in x):
        return validation_errors(x, force_n)
    groups, forces = (known(samples, with_validation=True) for samples in (together, force_n))
    if len(np.unique(groups[forces.any(axis=1)])) < FEWEST_GROUPS:
        return validation_errors(x, force_n)
    return cross_validation_errors(x, force_n, together)


def cross_validation_errors(
    x: dict[str, np.ndarray], force_n: dict[str, np.ndarray], together: dict[str, np.ndarray]
) -> list[dict]:
    """As `validation_errors`, but each frame of all splits is held out once, in one of FOLDS random parts.

    together : (frames,) integers by split name, the same for frames that belong together, as those of one
        press do: they are held out together, for the others would tell their force
    Slower, and steadier: with few frames in the split validation, chance decides what is best on them.
    """
    x, force_n, groups = (known(samples, with_validation=True) for samples in (x, force_n, together))
    names, group = np.unique(groups, return_inverse=True)
    part = (np.random.default_rng(0).permutation(len(names)) % FOLDS)[group]
    errors = np.empty((len(REGULARISATION), len(x)))
    for k in range(min(FOLDS, len(names))):
        held = part == k
        found = solve(x[~held], force_n[~held], REGULARISATION)
        errors[:, held] = np.abs(x[held] @ found - force_n[held]).sum(axis=2)
    return _history(errors)


def best_weights(x: dict[str, np.ndarray], force_n: dict[str, np.ndarray]) -> tuple[np.ndarray, list[dict]]:
    """The weights (features, axes) with the best regularisation, and all `validation_errors`.

    With a validation split a single decomposition serves both.
    """
    history, weights = _try_all(x, force_n)
    if "validation" in x:
        return weights[history.index(best(history))], history
    return fit(x["train"], force_n["train"], best(history)), history


def _try_all(x, force_n) -> tuple[list[dict], np.ndarray]:
    """The validation errors, and the weights (regularisations, features, axes) fitted without held-out
    frames."""
    if "validation" in x:
        seen, unseen = (x["train"], force_n["train"]), (x["validation"], force_n["validation"])
    else:
        held = np.arange(len(x["train"])) % HELD_OUT == HELD_OUT - 1
        seen, unseen = ((x["train"][part], force_n["train"][part]) for part in (~held, held))
    found = solve(*seen, REGULARISATION)
    return _history(np.abs(unseen[0] @ found - unseen[1]).sum(axis=2)), found


def _history(errors: np.ndarray) -> list[dict]:
    """What `validation_errors` returns, from the errors (regularisations, frames) of held-out frames in N."""
    means = errors.mean(axis=1)
    beyond = (errors - errors[means.argmin()]).std(axis=1) / np.sqrt(errors.shape[1])
    columns = (REGULARISATION.tolist(), means.tolist(), beyond.tolist())
    names = ("regularisation", "validation_mae_n", "standard_error_n")
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def best(history: list[dict]) -> dict:
    """The entry of `validation_errors` with the smallest error."""
    return min(history, key=lambda entry: entry["validation_mae_n"])


def strongest(history: list[dict]) -> dict:
    """The entry of the strongest regularisation whose error is not larger than the smallest one by more than
    the standard error of their difference.

    Where errors hardly differ, chance decides which is the smallest. Weights of a stronger regularisation are
    smaller, and lose less when they are rounded to integers.
    """
    smallest = best(history)["validation_mae_n"]
    as_good = [
        entry for entry in history if entry["validation_mae_n"] <= smallest + entry["standard_error_n"]
    ]
    return max(as_good, key=lambda entry: entry["regularisation"])


def fit(x: np.ndarray, force_n: np.ndarray, attempt: dict) -> np.ndarray:
    """Weights (features, axes) from all frames of x (frames, features), with the regularisation of
    `attempt`."""
    return solve(x, force_n, np.array([attempt["regularisation"]]))[0]


def fit_known(
    x: dict[str, np.ndarray], force_n: dict[str, np.ndarray], attempt: dict, *, with_validation: bool
) -> np.ndarray:
    """As `fit`, of the frames by split name that are `known`."""
    return fit(*(known(samples, with_validation=with_validation) for samples in (x, force_n)), attempt)


def known(samples: dict[str, np.ndarray], *, with_validation: bool) -> np.ndarray:
    """The training split's features or forces (frames, …) or, with_validation, all splits' one after another.

    Once the regularisation is chosen, the frames that chose it can be fitted too: weights of more frames are
    better, and depend less on which frames were held out.
    """
    return np.concatenate([*samples.values()]) if with_validation else samples["train"]


def joined(x: np.ndarray, shifts_px: np.ndarray | None) -> np.ndarray:
    """Features x (frames, features) and the dots' shifts (frames, M, 2), if any, side by side."""
    return x if shifts_px is None else np.concatenate([x, shifts_px.reshape(len(x), -1)], axis=1)


def parted(weights: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Weights (features, axes) of `joined` features as those of the first `count`, (count, axes), and those
    of the shifts, (axes, M, 2), None without."""
    of_dots = weights[count:].T.reshape(weights.shape[1], -1, 2)
    return weights[:count], of_dots if of_dots.size else None
