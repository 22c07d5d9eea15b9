"""Ridge regression of the force on images, with weights that are polynomials of a pixel's place on the skin.

F = Σ_pixels Σ_t w_t · x_t for images x_t, such as the terms of a displacement (models/integer/force.py).
Each field w_t is a polynomial of the pixel's normalised coordinates x, y and z on the skin at rest, z its
depth: on a curved skin, what a displacement presses with follows from where the pixel is and how steep the
skin is. On a flat skin z is the same everywhere and drops out. The regularisation is the strongest that is as
good as the best on frames held out (`ridge.held_out_errors`).
"""

from itertools import product

import numpy as np

from fastac.models.training.force import ridge

DEGREE = 3
"""Total degree of the polynomials, which have 20 coefficients. In cross-validation on the simulated fingertip
(scenes/fast.toml, bends at 0.04 and 0.15 mm, integers, mean of three trainings) degrees 1 to 5 have errors of
13.2, 4.0, 3.6, 3.4 and 3.5 mN, mean of x, y, z; those of degrees above 3 differ more between trainings."""
HARDLY_SHOWN = 1e-3
"""Root mean square of a term, relative to that of the largest one, below which it gets no weights: the
penalty scales with what is seen, and would let noise in a few pixels decide what the term is worth."""


def monomials(coordinate: np.ndarray, degree: int = DEGREE) -> np.ndarray:
    """All products of powers of coordinates (N, N, 3) up to a total degree, (N·N, count)."""
    powers = [p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree]
    flat = coordinate.reshape(-1, 3)
    return np.stack([np.prod(flat**power, axis=1) for power in powers], axis=1)


def hardly_shown(images: np.ndarray) -> np.ndarray:
    """Which terms of images (frames, N, N, terms) get no weights, (terms,) bool."""
    shown = np.sqrt(
        np.mean([np.square(frame, dtype=np.float64).mean(axis=(0, 1)) for frame in images], axis=0)
    )
    return shown < HARDLY_SHOWN * shown.max()


def fit(
    coordinate: np.ndarray,
    images: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    shifts_px: dict[str, np.ndarray] | None = None,
    *,
    with_validation: bool = False,
    together: dict[str, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray | None, list[dict]]:
    """Fit the weights of the images, (axes, N, N, terms) in N per their unit, and of the dots' shifts, (axes,
    M, 2) in N per px; returns them, None without shifts, and the errors as `ridge.validation_errors`.

    coordinate : (N, N, 3), as `floating.hyperforce.coordinates`
    images : (frames, N, N, terms), force_n : (frames, axes), shifts_px : (frames, M, 2) of marker dots, if
        any; by split name
    with_validation : whether the weights are fitted to the frames of both splits instead of those of the
        train split
    together : which frames belong together; with it the regularisation is chosen as by
        `ridge.held_out_errors`
    """
    ridge.check(force_n)
    of_place, without = monomials(coordinate), hardly_shown(images["train"])

    def moments(frame: np.ndarray) -> np.ndarray:
        return (of_place.T @ np.where(without, 0, frame).reshape(len(of_place), -1)).ravel()

    x = {
        split: ridge.joined(np.array([moments(frame) for frame in frames]), shifts_px and shifts_px[split])
        for split, frames in images.items()
    }
    history = ridge.held_out_errors(x, force_n, together, with_validation=with_validation)
    found = ridge.fit_known(x, force_n, ridge.strongest(history), with_validation=with_validation)
    count, terms = of_place.shape[1], len(without)
    found, of_dots = ridge.parted(found, count * terms)
    fields = np.einsum("pm,mta->apt", of_place, found.reshape(count, terms, -1)) * ~without
    return fields.reshape(-1, *coordinate.shape[:2], terms), of_dots, history
