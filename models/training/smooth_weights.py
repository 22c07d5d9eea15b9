"""Ridge regression of the force on images, with weights that are smooth over the image.

F = Σ_pixels Σ_t w_t · x_t for images x_t, such as the slopes less those of the background frame (a·Δp + b·Δq)
or the displacement. The fields w_t, sums of the lowest m × m cosines (DCT-II), are fitted by ridge regression
(models/training/ridge.py), together with two weights for each marker dot where there are any; m and the
regularisation are those of the smallest error on held-out frames. Fitted to what a pipeline finds, the
weights take its noise and errors into account, which those that models/floating/adjoint.py derives do not.

Presses at few places leave open how the weights go on between them. Copies of the frames that are moved a
little, with the same force, say so: on a gel that is alike everywhere a press has the same force elsewhere.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.fft import dctn, idct, idctn

from fastac.models.training import ridge
from fastac.store.progress import progress_bar

SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32)
"""Numbers m of cosines along each axis that are tried."""
MOVED_COPIES = 2
"""Of each training frame."""


def cosine_basis(length: int, size: int) -> np.ndarray:
    """The `size` lowest cosines of the orthonormal DCT-II over `length` pixels, (length, size)."""
    return idct(np.eye(length)[:, :size], axis=0, norm="ortho")


def lowest_cosines(images: Iterable[np.ndarray], size: int) -> np.ndarray:
    """DCT-II coefficients of the lowest size × size cosines, images (H, W, terms) to (frames, size, size,
    terms)."""
    return np.stack([dctn(frame, axes=(0, 1), norm="ortho")[:size, :size] for frame in images])


def moved(images: np.ndarray, reach: float, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Each of the images (frames, H, W, terms), moved along both axes by whole pixels chosen by chance.

    reach : the largest distance, as a share of the image's smaller side
    What comes in at a border is what was there.
    """
    height, width = images.shape[1:3]
    most = round(reach * min(height, width))
    for image in images:
        down, right = rng.integers(-most, most + 1, 2)
        rows = np.clip(np.arange(height) - down, 0, height - 1)
        yield image[rows[:, None], np.clip(np.arange(width) - right, 0, width - 1)]


def fit(
    images: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    shifts_px: dict[str, np.ndarray] | None = None,
    *,
    with_validation: bool = False,
    reach: float = 0.0,
    patience: int | None = None,
    progress: bool = False,
) -> tuple[np.ndarray, np.ndarray | None, list[dict]]:
    """Fit the weights of the images, (axes, H, W, terms) in N, and of the dots' shifts, (axes, M, 2) in N per
    px; returns them, None without shifts, and the errors of all m tried.

    images : (frames, H, W, terms) by split name, such as slopes less those of the background, with two terms
    force_n : (frames, axes), shifts_px : (frames, M, 2), by split name
    with_validation : whether the weights are fitted to the frames of both splits once m and the
        regularisation are chosen, instead of to those of the train split
    reach : how far copies of the train split's images are moved, as in `moved`; none are where it is 0, where
        there are dots, whose shifts belong to their places, or no validation split, for the copies of a frame
        that is held out would tell its force
    patience : how many m in a row, from the smallest on, may not lower the error before no larger one is
        tried; None: all are tried. The largest take nearly all of the time.
    """
    height, width, terms = images["train"].shape[1:]
    sizes = [size for size in SIZES if size <= min(height, width)]
    x = {split: lowest_cosines(values, sizes[-1]) for split, values in images.items()}
    if reach and shifts_px is None and "validation" in images:
        rng = np.random.default_rng(0)
        copies = [lowest_cosines(moved(images["train"], reach, rng), sizes[-1]) for _ in range(MOVED_COPIES)]
        x["train"] = np.concatenate([x["train"], *copies])
        force_n = {**force_n, "train": np.tile(force_n["train"], (1 + MOVED_COPIES, 1))}

    def features(split: str, size: int) -> np.ndarray:
        lowest = x[split][:, :size, :size].reshape(len(x[split]), -1)
        return ridge.joined(lowest, shifts_px and shifts_px[split])

    history, waited, smallest = [], 0, np.inf
    for size in progress_bar(sizes, desc="force, weights", unit="basis", enabled=progress):
        part = {split: features(split, size) for split in x}
        found = [{"cosines": size, **entry} for entry in ridge.validation_errors(part, force_n)]
        history += found
        error = ridge.best(found)["validation_mae_n"]
        waited = 0 if error < smallest else waited + 1
        smallest = min(error, smallest)
        if waited == patience:
            break
    chosen = ridge.best(history)
    size = chosen["cosines"]
    seen = ridge.known({split: features(split, size) for split in x}, with_validation=with_validation)
    found = ridge.fit(seen, ridge.known(force_n, with_validation=with_validation), chosen)
    of_images, of_dots = ridge.parted(found, size * size * terms)
    padded = np.zeros((found.shape[1], height, width, terms))
    padded[:, :size, :size] = of_images.T.reshape(-1, size, size, terms)
    return idctn(padded, axes=(1, 2), norm="ortho"), of_dots, history
