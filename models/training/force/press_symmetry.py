"""Weights of the slopes for a gel that is alike in all directions: a mirrored press has the mirrored force.

Let p = ∂z/∂x and q = ∂z/∂y be the slopes of a press. Mirrored at the image's vertical axis it has mirrored
slopes, p with the other sign, and the same force, but for F_x, whose sign changes. Mirroring at both axes
leaves, of all cosines cos(k_y, k_x) of p and q, a quarter that weights can be made of:

    F_z:  p with k_y even, k_x odd;   q with k_y odd, k_x even
    F_x:  p with k_y even, k_x even;  q with k_y odd, k_x odd
    F_y:  p with k_y odd, k_x odd;    q with k_y even, k_x even

On a square image a press can be turned by a quarter, too. Then F_z has the same weights for p and, with rows
and columns exchanged, for q: an eighth of all weights is left. A few objects, pressed at few places and in
few directions, determine this eighth far better than they determine all weights. But for the regularisation
it is as if weights were fitted to all mirrored and, for F_z, turned copies of the presses. (Cohen, Welling,
"Group Equivariant Convolutional Networks", 2016, build such symmetries into networks.)

All this is true of the skin's slopes. A network that learned from forces alone may give something else, which
then has a curl that slopes of a surface have not (integrability.py). And light and gel may differ from side
to side. So the last fit is repeated without each recording, with the symmetry and without it.
"""

import numpy as np
import torch

from fastac.models.training.force import ridge
from fastac.models.training.force.force_from_pixels import block_averages
from fastac.models.training.force.integrability import curl_share
from fastac.models.training.force.smooth_weights import SmoothWeights

ODD = {"x": ((0, 0), (1, 1)), "y": ((1, 1), (0, 0)), "z": ((0, 1), (1, 0))}
"""For each axis of the force whether k_y and k_x are odd, of p's cosines and of q's."""


LARGEST_CURL = 0.25
"""`curl_share` up to which a network's outputs are taken for slopes: half of that of noise. Of networks that
learned from forces alone it was 0.03 to 0.11 where training began with slopes of surfaces, and 0.24 to 0.61
where it did not."""
JUDGED_PX, JUDGED_FRAMES = 3, 500
"""Sides of the squares over which outputs are averaged before, so that the noise of pixels says less; and so
many frames at most."""


def are_slopes(slopes: np.ndarray) -> bool:
    """Whether a network's outputs (frames, H, W, 2) have as little curl as slopes of surfaces."""
    _, height, width, _ = slopes.shape
    whole = slopes[:, : height // JUDGED_PX * JUDGED_PX, : width // JUDGED_PX * JUDGED_PX]
    means = block_averages(whole[:: -(-len(slopes) // JUDGED_FRAMES)].astype(np.float32), JUDGED_PX)
    return curl_share(torch.from_numpy(means)).item() <= LARGEST_CURL


def places(axis: str, size: int, *, square: bool) -> np.ndarray:
    """Indices of the size × size × 2 coefficients that an axis' weights consist of, as a
    `smooth_weights.Restriction` gives them; those in one column are equal.

    square : whether a quarter turn of the image is an image, too
    """
    index = np.arange(size * size * 2).reshape(size, size, 2)
    (p_y, p_x), (q_y, q_x) = ODD[axis]
    p, q = index[p_y::2, p_x::2, 0], index[q_y::2, q_x::2, 1]
    if axis == "z" and square:
        return np.stack([p.ravel(), q.T.ravel()])
    return np.concatenate([p.ravel(), q.ravel()])[None]


def left_out(
    plain: SmoothWeights,
    slopes: np.ndarray,
    axes: tuple[str, ...],
    recording: dict[str, np.ndarray],
    **keys,
) -> dict[bool, tuple[SmoothWeights, list[dict]]]:
    """Regressions and their errors on recordings left out (`SmoothWeights.errors`), without the symmetry
    (False) and, where the train split's `slopes` (frames, H, W, 2) are those of surfaces, with it (True).

    plain : regressions on the same slopes, without the symmetry; axes, recording : as in `fit`
    keys : of `SmoothWeights.errors`
    """
    height, width = plain.shape[:2]

    def restrict(column: int, size: int) -> np.ndarray:
        return places(axes[column], size, square=height == width)

    candidates = {False: plain}
    if are_slopes(slopes):
        candidates[True] = plain.restricted(restrict)
    return {
        symmetric: (model, model.errors(recording=recording, **keys))
        for symmetric, model in candidates.items()
    }


def fit(
    slopes: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    axes: tuple[str, ...],
    recording: dict[str, np.ndarray],
    *,
    robust: bool = False,
    patience: int | None = None,
    progress: bool = False,
) -> tuple[np.ndarray, list[dict]]:
    """Weights (axes, H, W, 2) in N, symmetric where `are_slopes` and that lowers the error on recordings left
    out of this fit; and their errors, as in `smooth_weights.fit`, with "symmetric" in each for whether they
    are.

    The network that gave the slopes knew all recordings: the errors compare fits, and say little of new
    objects.

    slopes : (frames, H, W, 2), less those of the background, by split name
    axes : the names of the forces' columns
    The others are as in `smooth_weights.fit`.
    """
    plain = SmoothWeights(slopes, force_n, robust=robust)
    fits = left_out(plain, slopes["train"], axes, recording, patience=patience, progress=progress)
    best = min(fits, key=lambda symmetric: ridge.best(fits[symmetric][1])["validation_mae_n"])
    model, history = fits[best]
    weights, _, history = model.average(history)
    return weights, [{**entry, "symmetric": best} for entry in history]
