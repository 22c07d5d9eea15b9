"""Ridge regression of the force on the slopes: F = Σ (a·Δp + b·Δq), with a and b smooth over the image.

Δp and Δq are the slopes less those of the background frame. The fields a and b, sums of the lowest m × m
cosines (DCT-II), are fitted by ridge regression (models/training/ridge.py); m and the regularisation are
those of the smallest error on held-out frames. They replace the weights that models/floating/adjoint.py
derives from weights of the displacement; fitted to found slopes, they take the pixel network's noise and
errors into account.
"""

import numpy as np
from scipy.fft import dctn, idct, idctn

from fastac.models.training import ridge
from fastac.store.progress import progress_bar

SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32)
"""Numbers m of cosines along each axis that are tried."""


def cosine_basis(length: int, size: int) -> np.ndarray:
    """The `size` lowest cosines of the orthonormal DCT-II over `length` pixels, (length, size)."""
    return idct(np.eye(length)[:, :size], axis=0, norm="ortho")


def lowest_cosines(change: np.ndarray, size: int) -> np.ndarray:
    """DCT-II coefficients of the lowest size × size cosines, (frames, H, W, terms) to (frames, size, size,
    terms)."""
    return np.stack([dctn(frame, axes=(0, 1), norm="ortho")[:size, :size] for frame in change])


def fit(
    change: dict[str, np.ndarray], force_n: dict[str, np.ndarray], *, progress: bool = False
) -> tuple[np.ndarray, list[dict]]:
    """Fit the weights of the slopes, (axes, H, W, terms) in N; returns them and the errors of all m tried.

    change : (frames, H, W, terms) by split name, such as slopes less those of the background, with two terms
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
