"""Ridge regression of the force on images, with weights that are smooth over the image.

F = Σ_pixels Σ_t w_t · x_t for images x_t, such as the slopes less those of the background frame (a·Δp + b·Δq)
or the displacement. The fields w_t, sums of the lowest m × m cosines (DCT-II), are fitted by ridge regression
(models/training/force/ridge.py), together with two weights for each marker dot where there are any; m and the
regularisation are those of the smallest error on held-out frames (`ridge.held_out_errors`). Where recordings
are left out instead (`left_out.errors_n`), the fields of all m are averaged, so that little hangs on few
recordings' choice of one.
Fitted to what a pipeline finds, the weights take its noise and errors into account, which those that
models/floating/adjoint.py derives do not.
"""

import copy
from collections.abc import Callable, Iterable
from functools import partial
from itertools import groupby
from typing import NamedTuple, Self

import numpy as np
from scipy.fft import dctn, idct, idctn

from fastac.models.training.force import left_out, ridge, robust_ridge
from fastac.store.progress import progress_bar

SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32)
"""Numbers m of cosines along each axis that are tried."""

SHARPNESS = 4
"""The share of fields in an average falls with this power of their error on recordings left out: of an error
twice as large a sixteenth, so that what is much worse does not count."""

Restriction = Callable[[int, int], np.ndarray]
"""Which cosines an axis' fields are made of. Called with the axis' column in the forces and the size m, it
gives indices (cosines that share a weight, weights) into the m · m · terms coefficients; all others are
zero."""


def cosine_basis(length: int, size: int) -> np.ndarray:
    """The `size` lowest cosines of the orthonormal DCT-II over `length` pixels, (length, size)."""
    return idct(np.eye(length)[:, :size], axis=0, norm="ortho")


def lowest_cosines(images: Iterable[np.ndarray], size: int) -> np.ndarray:
    """DCT-II coefficients of the lowest size × size cosines, images (H, W, terms) to (frames, size, size,
    terms)."""
    return np.stack([dctn(frame, axes=(0, 1), norm="ortho")[:size, :size] for frame in images])


class _Problem(NamedTuple):
    """One ridge regression: some columns of the forces on features that they have in common."""

    columns: slice
    places: np.ndarray | None
    """As a `Restriction` gives them; None: all coefficients."""
    features: dict[str, np.ndarray]
    """(frames, n) by split name, as the forces."""
    force_n: dict[str, np.ndarray]


class SmoothWeights:
    """Ridge regressions of forces on images whose weights are sums of cosines.

    images : (frames, H, W, terms) by split name, such as slopes less those of the background, with two terms
    force_n : (frames, axes), shifts_px : (frames, M, 2) of marker dots, if any; by split name

    robust : whether weights are fitted with Huber's loss (models/training/force/robust_ridge.py)

    Every cosine of every term has a weight of its own, but in `restricted` regressions.
    """

    def __init__(
        self,
        images: dict[str, np.ndarray],
        force_n: dict[str, np.ndarray],
        shifts_px: dict[str, np.ndarray] | None = None,
        *,
        robust: bool = False,
    ):
        self.shape, self.shifts_px = images["train"].shape[1:], shifts_px
        self.robust = robust
        self.restrict: Restriction | None = None
        self.sizes = [size for size in SIZES if size <= min(self.shape[:2])]
        self.cosines = {split: lowest_cosines(values, self.sizes[-1]) for split, values in images.items()}
        self.force_n = force_n

    def restricted(self, restrict: Restriction) -> Self:
        """Regressions on the same frames, with fields made of what `restrict` says."""
        found = copy.copy(self)
        found.restrict = restrict
        return found

    def _problems(self, size: int) -> list[_Problem]:
        axes = self.force_n["train"].shape[1]
        if self.restrict is None:
            parts = [(slice(0, axes), None)]
        else:
            parts = [(slice(axis, axis + 1), self.restrict(axis, size)) for axis in range(axes)]
        return [
            _Problem(
                part,
                places,
                {split: self._features(split, size, places) for split in self.cosines},
                {split: values[:, part] for split, values in self.force_n.items()},
            )
            for part, places in parts
        ]

    def _features(self, split: str, size: int, places: np.ndarray | None) -> np.ndarray:
        lowest = self.cosines[split][:, :size, :size].reshape(len(self.cosines[split]), -1)
        if places is not None:
            lowest = lowest[:, places].sum(axis=1)
        return ridge.joined(lowest, self.shifts_px and self.shifts_px[split])

    def errors(
        self,
        *,
        recording: dict[str, np.ndarray] | None = None,
        together: dict[str, np.ndarray] | None = None,
        with_validation: bool = False,
        patience: int | None = None,
        largest: int = SIZES[-1],
        progress: bool = False,
    ) -> list[dict]:
        """Errors on held-out frames of all sizes and strengths, [{"cosines": …, "regularisation": …,
        "validation_mae_n": …}].

        recording : (frames,) by split name; with it each recording of all splits is left out once
            (`left_out.errors_n`)
        together, with_validation : as in `ridge.held_out_errors`, for fits without `recording`
        patience : how many m in a row, from the smallest on, may not lower the error before no larger one is
            tried; None: all are tried. The largest take nearly all of the time.
        largest : the largest m that is tried
        """
        ridge.check(self.force_n)
        if recording is None:
            find = partial(ridge.held_out_errors, together=together, with_validation=with_validation)
        else:
            find = partial(self._left_out, np.concatenate([recording[split] for split in self.cosines]))
        history, waited, smallest = [], 0, np.inf
        sizes = [size for size in self.sizes if size <= largest]
        for size in progress_bar(sizes, desc="force, weights", unit="basis", enabled=progress):
            of_axes = [find(x, force_n) for _, _, x, force_n in self._problems(size)]
            found = [
                {
                    "cosines": size,
                    "regularisation": same[0]["regularisation"],
                    "validation_mae_n": sum(e["validation_mae_n"] for e in same),
                }
                for same in zip(*of_axes, strict=True)
            ]
            history += found
            error = ridge.best(found)["validation_mae_n"]
            waited = 0 if error < smallest else waited + 1
            smallest = min(error, smallest)
            if waited == patience:
                break
        return history

    def _left_out(
        self,
        recording: np.ndarray,
        x: dict[str, np.ndarray],
        force_n: dict[str, np.ndarray],
    ) -> list[dict]:
        """`left_out.errors_n` of all splits, in the form of `ridge.held_out_errors`."""
        x, force_n = (ridge.known(values, with_validation=True) for values in (x, force_n))
        errors_n = left_out.errors_n(x, force_n, recording, robust=self.robust)
        return [
            {"regularisation": strength, "validation_mae_n": error}
            for strength, error in zip(ridge.REGULARISATION.tolist(), errors_n.tolist(), strict=True)
        ]

    def weights(self, chosen: dict, *, with_validation: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """The fields (axes, H, W, terms) and the dots' weights (axes, M, 2) of an entry of `errors`.

        with_validation : whether they are fitted to the frames of both splits instead of the train split's
        """
        *outer, terms = self.shape
        size, fields, of_dots = chosen["cosines"], [], []
        for _, places, x, force_n in self._problems(size):
            x, force_n = (ridge.known(values, with_validation=with_validation) for values in (x, force_n))
            found = (robust_ridge if self.robust else ridge).fit(x, force_n, chosen)
            if places is None:
                places = np.arange(size * size * terms)[None]
            of_images, dots = ridge.parted(found, places.shape[1])
            flat = np.zeros((found.shape[1], size * size * terms))
            flat[:, places] = of_images.T[:, None]
            fields.append(flat.reshape(-1, size, size, terms))
            of_dots.append(dots)
        padded = np.zeros((sum(map(len, fields)), *outer, terms))
        padded[:, :size, :size] = np.concatenate(fields)
        dots = None if of_dots[0] is None else np.concatenate(of_dots)
        return idctn(padded, axes=(1, 2), norm="ortho"), dots

    def average(self, history: list[dict]) -> tuple[np.ndarray, np.ndarray | None, list[dict]]:
        """The average of fields, and of weights of dots, over all sizes, each with its best regularisation;
        and the history with every entry's "share" in the average.

        history : `errors` on recordings left out. Weights are fitted to the train split.
        """
        history = [entry | {"share": 0.0} for entry in history]
        chosen = [ridge.best(same) for _, same in groupby(history, key=lambda entry: entry["cosines"])]
        errors = np.array([entry["validation_mae_n"] for entry in chosen])
        least = max(errors.min(), np.finfo(float).tiny)
        shares = (np.maximum(errors, least) / least) ** -SHARPNESS
        shares /= shares.sum()
        fields, dots = 0.0, None
        for entry, share in zip(chosen, shares.tolist(), strict=True):
            entry["share"] = share
            found, of_dots = self.weights(entry, with_validation=False)
            fields = fields + share * found
            if of_dots is not None:
                dots = share * of_dots + (0.0 if dots is None else dots)
        return fields, dots, history


def fit(
    images: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    shifts_px: dict[str, np.ndarray] | None = None,
    *,
    with_validation: bool = False,
    recording: dict[str, np.ndarray] | None = None,
    together: dict[str, np.ndarray] | None = None,
    robust: bool = False,
    patience: int | None = None,
    progress: bool = False,
) -> tuple[np.ndarray, np.ndarray | None, list[dict]]:
    """Fit the weights of the images, (axes, H, W, terms) in N, and of the dots' shifts, (axes, M, 2) in N per
    px; returns them, None without shifts, and the errors of all m tried.

    Those of the best m or, with `recording`, the `SmoothWeights.average` of those of all.

    images, force_n, shifts_px, robust : as in `SmoothWeights`; recording, patience : as in its `errors`
    with_validation : whether the weights are fitted to the frames of both splits instead of those of the
        train split
    together : which frames belong together; with it m and the regularisation are chosen as by
        `ridge.held_out_errors`
    """
    model = SmoothWeights(images, force_n, shifts_px, robust=robust)
    history = model.errors(
        recording=recording,
        together=together,
        with_validation=with_validation,
        patience=patience,
        progress=progress,
    )
    if recording is not None:
        return model.average(history)
    return *model.weights(ridge.best(history), with_validation=with_validation), history
