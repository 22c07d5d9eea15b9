"""The adjoint's weights learned directly: F = Σ (a·Δp + b·Δq), a and b smooth over the image.

Δp, Δq are the slopes less those at rest. Each field is a sum of the lowest m × m cosines (DCT-II) and the fit
is ridge regression (models/training/ridge.py); m and the regularisation are those of the smallest error on frames that
were not fitted. Unlike weights that come from the displacement through the adjoint, these know how noise and
errors of the pixel network appear in the slopes.
"""

import numpy as np
from scipy.fft import dctn, idct, idctn

from fastac.models.training import ridge
from fastac.store.progress import progress_bar

SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32)
"""Cosines along each axis that are tried."""


def cosine_basis(length: int, size: int) -> np.ndarray:
    """The lowest cosines over `length` pixels, (length, size)."""
    return idct(np.eye(length)[:, :size], axis=0, norm="ortho")


def lowest_cosines(change: np.ndarray, size: int) -> np.ndarray:
    """The lowest cosines of slopes' differences (frames, H, W, terms): (frames, size, size, terms)."""
    return np.stack([dctn(frame, axes=(0, 1), norm="ortho")[:size, :size] for frame in change])


def fit(
    change: dict[str, np.ndarray], force_n: dict[str, np.ndarray], *, progress: bool = False
) -> tuple[np.ndarray, list[dict]]:
    """Weights of the slopes (axes, H, W, 2) in N, and the errors of all that was tried.

    change : slopes less those at rest (frames, H, W, 2) by split name, or any other number of terms a pixel
    force_n : (frames, axes) by split name
    """
    height, width, terms = change["train"].shape[1:]
    sizes = [size for size in SIZES if size <= min(height, width)]
    x = {split: lowest_cosines(values, sizes[-1]) for split, values in change.items()}
    history = []
    for size in progress_bar(sizes, desc="force, slopes", unit="basis", enabled=progress):
        part = {split: values[:, :size, :size].reshape(len(values), -1) for split, values in x.items()}
        history += [{"cosines": size, **entry} for entry in ridge.validation_errors(part, force_n)]
    chosen = ridge.best(history)
    size = chosen["cosines"]
    kept = x["train"][:, :size, :size].reshape(len(x["train"]), -1)
    found = ridge.fit(kept, force_n["train"], chosen)
    padded = np.zeros((found.shape[1], height, width, terms))
    padded[:, :size, :size] = found.T.reshape(-1, size, size, terms)
    return idctn(padded, axes=(1, 2), norm="ortho"), history
