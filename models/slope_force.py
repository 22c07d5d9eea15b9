"""The adjoint's weights learned directly: F = Σ (a·Δp + b·Δq), a and b smooth over the image.

Δp, Δq are the slopes less those at rest. Each field is a sum of the lowest m × m cosines (DCT-II) and the fit
is ridge regression, so it has one solution: no start, no steps, no seed. m and the regularisation are those
of the smallest error on frames that were not fitted. Unlike weights that come from the displacement through
the adjoint, these know how noise and errors of the pixel network appear in the slopes.
Source: Hastie et al., "The Elements of Statistical Learning", 2nd ed., section 3.4.1.
"""

import numpy as np
from scipy.fft import dctn, idct, idctn
from tqdm import tqdm

SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32)
"""Cosines along each axis that are tried."""
REGULARISATION = 10.0 ** np.arange(-9, 1, 0.5)
"""Tried, relative to the mean eigenvalue of the frames' inner products."""
HELD_OUT = 5
"""Where there is no validation split every fifth training frame is held out for the choice."""


def waves(length: int, size: int) -> np.ndarray:
    """The lowest cosines over `length` pixels, (length, size)."""
    return idct(np.eye(length)[:, :size], axis=0, norm="ortho")


def spectra(change: np.ndarray, size: int) -> np.ndarray:
    """The lowest cosines of slopes' differences (frames, H, W, terms): (frames, size, size, terms)."""
    return np.stack([dctn(frame, axes=(0, 1), norm="ortho")[:size, :size] for frame in change])


def solve(x: np.ndarray, force_n: np.ndarray, regularisation: np.ndarray) -> np.ndarray:
    """Ridge weights (regularisations, features, axes) of x (frames, features), each scaled to its own spread.

    One singular value decomposition serves all strengths of the regularisation.
    """
    spread = np.sqrt((x**2).mean(axis=0, dtype=np.float64))
    spread = np.where(spread > 0, spread, 1)
    u, s, vh = np.linalg.svd(x / spread, full_matrices=False)
    damped = s / (s**2 + regularisation[:, None] * (s**2).sum() / len(x))
    return vh.T @ (damped[..., None] * (u.T @ force_n)) / spread[:, None]


def fit(
    change: dict[str, np.ndarray], force_n: dict[str, np.ndarray], *, progress: bool = False
) -> tuple[np.ndarray, list[dict]]:
    """Weights of the slopes (axes, H, W, 2) in N, and the errors of all that was tried.

    change : slopes less those at rest (frames, H, W, 2) by split name, or any other number of terms a pixel
    force_n : (frames, axes) by split name
    """
    height, width, terms = change["train"].shape[1:]
    sizes = [size for size in SIZES if size <= min(height, width)]
    x = {split: spectra(values, sizes[-1]) for split, values in change.items()}
    if "validation" in x:
        seen, unseen = (x["train"], force_n["train"]), (x["validation"], force_n["validation"])
    else:
        held = np.arange(len(x["train"])) % HELD_OUT == HELD_OUT - 1
        seen, unseen = ((x["train"][part], force_n["train"][part]) for part in (~held, held))
    history = []
    for size in tqdm(sizes, desc="force, slopes", unit="basis", disable=not progress, leave=False):
        (a, b), (c, d) = ((x[:, :size, :size].reshape(len(x), -1), force) for x, force in (seen, unseen))
        for regularisation, weights in zip(REGULARISATION, solve(a, b, REGULARISATION), strict=True):
            error = c @ weights - d
            history.append(
                {
                    "cosines": size,
                    "regularisation": float(regularisation),
                    "validation_mae_n": float(np.abs(error).sum(axis=1).mean()),
                }
            )
    best = min(history, key=lambda entry: entry["validation_mae_n"])
    size = best["cosines"]
    kept = x["train"][:, :size, :size]
    (found,) = solve(kept.reshape(len(kept), -1), force_n["train"], np.array([best["regularisation"]]))
    padded = np.zeros((found.shape[1], height, width, terms))
    padded[:, :size, :size] = found.T.reshape(-1, size, size, terms)
    return idctn(padded, axes=(1, 2), norm="ortho"), history
