"""The linear models that training from forces alone begins with.

A ridge regression on the pixels' differences from the background has a weight field for each channel. A
network has two slopes a pixel, so its channels are mixed into two: into those that are nearest to slopes of
a surface, or into those that explain most of the ridge's force.
"""

from dataclasses import dataclass

import numpy as np
import torch

from fastac.models.floating.network import PixelNetwork
from fastac.models.integer.features import DIFFERENCE_SCALE, HIDDEN, differences
from fastac.models.training.force import press_symmetry, ridge, smooth_weights
from fastac.models.training.force.force_from_pixels import ForceFromPixels
from fastac.models.training.force.integrability import integrable_mixtures
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.samples import FORCE_AXES

INITIAL_SLOPE = 1.0
"""Scale of the linear model's slopes: their 99.99th percentile, a quarter of the default slope limit."""
WORSE = 1.25
"""A start from slopes of a surface has at most this multiple of the other start's validation error. More
means that the image is not that of a smooth surface: markers that move have edges which no slope has."""
JUDGED_COSINES = 12
"""Along each axis, of the largest fits that judge a start. Larger ones take nearly all of the time and tell
no more about which start is better."""


def background_differences(data: Dataset, index: np.ndarray, smoothing_px: int = 0) -> np.ndarray:
    """Frames `index` less the background as `features.differences`, (frames, H, W, C) float32."""
    return differences(data.frames[index], data.background, smoothing_px).astype(np.float32)


def _linear_fit(
    pixels: dict[str, np.ndarray], force_n: dict[str, np.ndarray], **keys
) -> tuple[smooth_weights.SmoothWeights, dict, np.ndarray]:
    """Regressions on the pixels (frames, H, W, terms), the entry of their `errors` with the smallest error on
    the validation frames, and its fields (axes, H, W, terms).

    force_n : (frames, axes), as the pixels by split name; keys : of `SmoothWeights.errors`
    """
    model = smooth_weights.SmoothWeights(pixels, force_n, robust=True)
    chosen = ridge.best(model.errors(**keys))
    return model, chosen, model.weights(chosen, with_validation=False)[0]


def force_mixtures(fields: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The two linear combinations of channels (2, C) that explain most of Σ fields · change.

    fields : (axes, H, W, C); change : (frames, H, W, C)
    By reduced-rank regression (Izenman, "Modern Multivariate Statistical Techniques", section 6.3). Each is
    scaled so that the 99.99th percentile of its magnitude is INITIAL_SLOPE.
    """
    channels = fields.shape[-1]
    flat = change.reshape(-1, channels).astype(np.float64)
    covariance = flat.T @ flat / len(flat)
    covariance[np.diag_indices(channels)] += 1e-6 * np.trace(covariance) + 1e-12
    root = np.linalg.cholesky(covariance)
    right = np.linalg.svd(fields.reshape(-1, channels) @ root, full_matrices=False).Vh[:2]
    mixtures = right @ np.linalg.inv(root)
    return mixtures * INITIAL_SLOPE / np.quantile(np.abs(flat @ mixtures.T), 1 - 1e-4, axis=0)[:, None]


def linear_network(mixtures: np.ndarray, hidden: tuple[int, ...] = HIDDEN) -> PixelNetwork:
    """A network whose slopes are the combinations `mixtures` (2, C) of the scaled differences: a linear
    model.

    The first four neurons of each layer carry the positive and the negative part of both combinations. The
    other neurons are initialised at random, with output weights of zero.
    """
    network = PixelNetwork(mixtures.shape[1] + 2, hidden)
    halves = torch.tensor(np.stack([mixtures[0], -mixtures[0], mixtures[1], -mixtures[1]]))
    first, *middle, last = network.linear_layers
    with torch.no_grad():
        for layer in (first, *middle):
            layer.weight[:4] = 0
            layer.bias[:4] = 0
        first.weight[:4, :-2] = halves
        for layer in middle:
            layer.weight[:4, :4] = torch.eye(4)
        last.weight[:] = 0
        last.weight[0, :2] = last.weight[1, 2:4] = torch.tensor([-1.0, 1.0])
    return network


def surface_mixtures(change: np.ndarray) -> np.ndarray:
    """The two combinations of channels (2, C) of `change` (frames, H, W, C) that are nearest to slopes.

    With one scale for both, so that the 99.99th percentile of all magnitudes is INITIAL_SLOPE.
    """
    mixtures = integrable_mixtures(change)
    magnitudes = np.abs(change @ mixtures.T.astype(change.dtype))
    return mixtures * INITIAL_SLOPE / np.quantile(magnitudes, 1 - 1e-4)


@dataclass(frozen=True, eq=False)
class LinearStart:
    """A linear model of the force on two mixtures of channels."""

    mixtures: np.ndarray
    fields: np.ndarray
    """(axes, H, W, 2), the weights of both, N."""
    cosines: int
    """Along each axis, of which the fields are sums."""
    validation_mae_n: float
    left_out_mae_n: float | None
    """On recordings left out, of the last fit that these mixtures would get; None where it chose nothing."""
    of_surfaces: bool
    """Whether the mixtures were chosen as slopes of surfaces, and not by the force that they explain."""


def linear_start(
    change: dict[str, np.ndarray],
    force_n: dict[str, np.ndarray],
    scene: Scene,
    recording: dict[str, np.ndarray] | None = None,
    *,
    progress: bool = False,
) -> LinearStart:
    """The linear model to begin with. That of slopes of surfaces, if the scene weighs their curl, unless the
    other's error on recordings left out is smaller or, where they are not known, its validation error far
    smaller (WORSE).

    Each is judged by the last fit that it would get: slopes of surfaces gain by the symmetry of presses
    (press_symmetry.py), other mixtures do not.

    change : (frames, H, W, C), differences from the background; force_n : (frames, axes); recording :
        (frames,), if there are at least two; all by split name
    """
    keys = {"patience": scene.training.patience_sizes, "progress": progress}
    if not scene.training.force_curl_weight:
        recording = None  # nothing is compared

    def with_mixtures(mixtures: np.ndarray, *, of_surfaces: bool) -> LinearStart:
        mixed = {split: (pixels @ mixtures.T).astype(np.float32) for split, pixels in change.items()}
        model, chosen, fields = _linear_fit(mixed, force_n, **keys)
        left_out_n = None
        if recording is not None:
            left_out_n = _left_out_mae_n(model, mixed["train"], scene, recording, progress=progress)
        return LinearStart(
            mixtures, fields, chosen["cosines"], chosen["validation_mae_n"], left_out_n, of_surfaces
        )

    _, _, fields = _linear_fit(change, force_n, **keys)
    best = with_mixtures(force_mixtures(fields, change["train"]), of_surfaces=False)
    if not scene.training.force_curl_weight:
        return best
    found = with_mixtures(surface_mixtures(change["train"]), of_surfaces=True)
    if recording is None:
        return found if found.validation_mae_n <= WORSE * best.validation_mae_n else best
    # On new objects slopes of a surface should be better. They are not where the image is seen at a slant, or
    # where one colour does not mean the same slope everywhere.
    return found if found.left_out_mae_n <= best.left_out_mae_n else best


def _left_out_mae_n(
    model: smooth_weights.SmoothWeights,
    mixed: np.ndarray,
    scene: Scene,
    recording: dict[str, np.ndarray],
    *,
    progress: bool,
) -> float:
    """The least mean absolute error in N on recordings left out, of the fits that the last one chooses from.

    mixed : the train split's two mixtures, (frames, H, W, 2)
    """
    keys = {"recording": recording, "largest": JUDGED_COSINES, "progress": progress}
    if scene.training.force_symmetry and not scene.wants_dots:  # as the last fit decides, in force_fits.py
        axes = tuple(FORCE_AXES[k] for k in scene.force_axes)
        fits = press_symmetry.left_out(model, mixed, axes, **keys)
        histories = [history for _, history in fits.values()]
    else:
        histories = [model.errors(**keys)]
    return min(ridge.best(history)["validation_mae_n"] for history in histories)


def initial_model(start: LinearStart, data: Dataset, scene: Scene) -> ForceFromPixels:
    """A linear model as a network and weight fields; its other neurons are initialised at random."""
    lowest = smooth_weights.lowest_cosines(start.fields, start.cosines)
    network = linear_network((start.mixtures / DIFFERENCE_SCALE).astype(np.float32), scene.network.hidden)
    return ForceFromPixels(network, lowest, data.background.shape, scene.numbers.slope_limit)
