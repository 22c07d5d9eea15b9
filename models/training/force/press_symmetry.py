"""Weights of the slopes for a gel that is alike in all directions: a mirrored press has the mirrored force.

Let p = ∂z/∂x and q = ∂z/∂y be the slopes of a press. Mirrored at the image's vertical axis it has mirrored
slopes, p with the other sign, and the same force, but for F_x, whose sign changes. Mirroring at both axes
leaves, of all cosines cos(k_y, k_x) of p and q, a quarter that weights can be made of:

    F_z:  p with k_y even, k_x odd;   q with k_y odd, k_x even
    F_x:  p with k_y even, k_x even;  q with k_y odd, k_x odd
    F_y:  p with k_y odd, k_x odd;    q with k_y even, k_x even

On a square image a press can be turned by a quarter, too. So the weights of F_z are the same for p and, with
rows and columns exchanged, for q: an eighth of all weights is left. A few objects, pressed at few places and
in few directions, determine them far better than all. It is as if the weights were fitted to all mirrored and
turned copies of the presses. (Cohen, Welling, "Group Equivariant Convolutional Networks", 2016, build such
symmetries into networks.)

All this is true of slopes of the skin. What a network takes for slopes may be none, and light and gel may
differ from side to side: recordings that are left out say whether the symmetry helps.
"""

from functools import partial

import numpy as np

from fastac.models.training.force import ridge
from fastac.models.training.force.smooth_weights import SmoothWeights

LEAST_GROUPS = 3
"""Recordings, of which each is left out once, that tell whether the symmetry helps; with fewer the validation
frames do."""
ODD = {"x": ((0, 0), (1, 1)), "y": ((1, 1), (0, 0)), "z": ((0, 1), (1, 0))}
"""For each axis of the force whether k_y and k_x are odd, of p's cosines and of q's."""


def places(axis: str, size: int, *, square: bool) -> np.ndarray:
    """Where an axis' weights are in size × size × 2 coefficients, as a `smooth_weights.Restriction` says.

    square : whether a quarter turn of the image is an image, too
    """
    index = np.arange(size * size * 2).reshape(size, size, 2)
    (p_y, p_x), (q_y, q_x) = ODD[axis]
    p, q = index[p_y::2, p_x::2, 0], index[q_y::2, q_x::2, 1]
    if axis == "z" and square:
        return np.stack([p.ravel(), q.T.ravel()])
    return np.concatenate([p.ravel(), q.ravel()])[None]


def fit(
    slopes: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    axes: tuple[str, ...],
    group: dict[str, np.ndarray] | None,
    *,
    with_validation: bool = False,
    reach: float = 0.0,
    patience: int | None = None,
    progress: bool = False,
) -> tuple[np.ndarray, list[dict]]:
    """Weights (axes, H, W, 2) in N, symmetric where that lowers the error on recordings left out; and
    their validation errors, as in `smooth_weights.fit`, with "mirrored" in each for whether they are.

    slopes : (frames, H, W, 2), less those of the background, by split name
    axes : the names of the forces' columns
    group : the recording of each frame by split name, if known. With fewer than LEAST_GROUPS the error on
        validation frames decides, and without such frames no weights are symmetric.
    reach : of moved copies, which only weights without symmetry are fitted to
    The others are as in `smooth_weights.fit`.
    """
    plain = SmoothWeights(slopes, force_n, reach=reach)
    height, width = plain.shape[:2]

    def restrict(column: int, size: int) -> np.ndarray:
        return places(axes[column], size, square=height == width)

    candidates = {False: plain}
    by_group = group is not None and len(np.unique(np.concatenate([*group.values()]))) >= LEAST_GROUPS
    if by_group or "validation" in slopes:
        candidates[True] = SmoothWeights(slopes, force_n, restrict=restrict)
    errors = partial(SmoothWeights.errors, patience=patience, progress=progress)
    histories = {mirrored: errors(model) for mirrored, model in candidates.items()}
    chosen = {mirrored: ridge.best(history) for mirrored, history in histories.items()}
    if by_group:
        error_n = {m: model.left_out_error(chosen[m], group) for m, model in candidates.items()}
    else:
        error_n = {m: entry["validation_mae_n"] for m, entry in chosen.items()}
    best = min(error_n, key=error_n.get)
    weights, _ = candidates[best].weights(chosen[best], with_validation=with_validation)
    return weights, [{**entry, "mirrored": best} for entry in histories[best]]
