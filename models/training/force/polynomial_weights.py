"""Ridge regression of the force on images, with weights that are polynomials of a pixel's place on the skin.

F = Σ_pixels Σ_t w_t · x_t for images x_t, such as the terms of a displacement (models/integer/force.py).
Each field w_t is a polynomial of the pixel's normalised coordinates x, y and z on the skin at rest, z its
depth: on a curved skin, what a displacement presses with follows from where the pixel is and how steep the
skin is. On a flat skin z is the same everywhere and drops out. The degree is the one with the smallest error
on frames held out (`ridge.held_out_errors`), with the strongest regularisation that is as good as its best.
"""

from itertools import product

import numpy as np

from fastac.models.training.force import ridge

DEGREES = (1, 2, 3, 4)
"""Total degrees of the polynomials that are tried; they have 4, 10, 20 and 35 coefficients. Which is best
follows from the number of presses: on the simulated fingertip (scenes/fast.toml, floats, mean of 13
trainings) degrees 3, 4 and 5 have errors of 1.93, 2.30 and 2.88 mN with 192 presses to train, and of 1.58,
1.57 and 1.60 mN with 768, mean of x, y, z."""
HARDLY_SHOWN = 1e-2
"""Root mean square of a term, relative to that of the largest one, below which it gets no weights: the
penalty scales with what is seen, and would let noise in a few pixels decide what the term is worth. Of a term
with 0.0014 the weights were 75 times the others', whose words then had six bits less: F_z was off by 78 mN in
integers and by 4 mN in floats. The terms that presses show have 0.2 and more."""


def powers(degree: int) -> np.ndarray:
    """The powers of x, y and z in all monomials up to a total degree, (count, 3); those of lower degrees come
    first."""
    every = [power for power in product(range(degree + 1), repeat=3) if sum(power) <= degree]
    return np.array(sorted(every, key=sum))


def monomials(coordinate: np.ndarray, degree: int) -> np.ndarray:
    """All products of powers of coordinates (N, N, 3) up to a total degree, (N·N, count), as `powers`."""
    flat = coordinate.reshape(-1, 3)
    return np.stack([np.prod(flat**power, axis=1) for power in powers(degree)], axis=1)


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
    M, 2) in N per px; returns them, None without shifts, and the errors of the chosen degree as
    `ridge.validation_errors`, with their "degree".

    coordinate : (N, N, 3), as `floating.hyperforce.coordinates`
    images : (frames, N, N, terms), force_n : (frames, axes), shifts_px : (frames, M, 2) of marker dots, if
        any; by split name
    with_validation : whether the weights are fitted to the frames of both splits instead of those of the
        train split
    together : which frames belong together; with it the regularisation is chosen as by
        `ridge.held_out_errors`
    """
    ridge.check(force_n)
    of_place, without = monomials(coordinate, DEGREES[-1]), hardly_shown(images["train"])
    terms = len(without)

    def moments(frame: np.ndarray) -> np.ndarray:
        return of_place.T @ np.where(without, 0, frame).reshape(len(of_place), -1)

    every = {split: np.array([moments(frame) for frame in frames]) for split, frames in images.items()}

    def features(degree: int) -> dict[str, np.ndarray]:
        count = len(powers(degree))
        return {
            split: ridge.joined(found[:, :count].reshape(len(found), -1), shifts_px and shifts_px[split])
            for split, found in every.items()
        }

    tried = {
        degree: ridge.held_out_errors(features(degree), force_n, together, with_validation=with_validation)
        for degree in DEGREES
    }
    degree = min(tried, key=lambda degree: ridge.strongest(tried[degree])["validation_mae_n"])
    history = [{"degree": degree, **entry} for entry in tried[degree]]
    x, chosen = features(degree), ridge.strongest(history)
    found = ridge.fit_known(x, force_n, chosen, with_validation=with_validation)
    count = len(powers(degree))
    found, of_dots = ridge.parted(found, count * terms)
    fields = np.einsum("pm,mta->apt", of_place[:, :count], found.reshape(count, terms, -1)) * ~without
    return fields.reshape(-1, *coordinate.shape[:2], terms), of_dots, history
