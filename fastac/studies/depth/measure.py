"""Signed errors of depth against the truth, and which part of the skin makes them.

Depth is linear in the slopes. So its error is the sum of what the errors of the slopes in each part of the
skin make of it, of what is clipped, and of what the solver adds.
"""

import numpy as np

from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.floating.poisson import solve, source_of
from fastac.models.integer.features import integer_features
from fastac.models.integer.laplacian import boundary_term
from fastac.sensor.dataset import Dataset

PARTS = {
    "contact": "slopes found wrong where skin and indenter touch",
    "shoulder": "slopes found wrong around the contact, up to 2.5 of its radii from the axis",
    "beyond": "slopes found wrong farther out, where the skin is all but flat",
    "limit": "slopes steeper than slope_limit",
    "border": "the border of the image has moved, and the solver holds it at zero",
    "solver": "differences in place of derivatives",
}
"""Where an error of the depth comes from."""
SHOULDER_RADII = 2.5


def found_slopes(
    network: PixelNetwork, data: Dataset, k: int, limit: float, smoothing_px: int = 0
) -> np.ndarray:
    """Slopes (H, W, 2) of frame k less those of the background, as difference mode solves them.

    smoothing_px : as in `integer_features`
    """
    frames = np.stack([data.frames[k], data.background])
    features = integer_features(frames, data.background, smoothing_px)
    pressed, rest = slopes_of(predict(network, features), limit)
    return pressed - rest


def true_slopes(data: Dataset, k: int) -> np.ndarray:
    normals = data.normals[k].astype(np.float64)
    return -normals[..., :2] / normals[..., 2:]


def errors_of(
    slopes: np.ndarray,
    data: Dataset,
    k: int,
    *,
    in_contact: np.ndarray,
    distance_radii: np.ndarray,
    limit: float,
    divergence: str,
) -> dict[str, float]:
    """Errors of one press from the slopes (H, W, 2) found in frame k; depth counts into the gel.

    in_contact : (H, W) bool; distance_radii : (H, W), from the indenter's axis, in the contact's radii

    Returns, in percent of the true ones, the errors of the largest depth, `depth`, and of the volume below
    the skin at rest, `volume`; `deepest_mm`, the true depth; `mae_um` over the image; `angle_rad`, of the
    slopes in contact; and by PARTS the error at the deepest point, in percent of its depth.
    """

    def depth_mm(field: np.ndarray) -> np.ndarray:
        return -solve(source_of(field, divergence)) * data.pitch_mm

    truth, true_mm = true_slopes(data, k), -data.depth_mm[k].astype(np.float64)
    clipped = np.clip(truth, -limit, limit)
    inner_mm, found_mm = true_mm[1:-1, 1:-1], depth_mm(slopes)
    shoulder = ~in_contact & (distance_radii <= SHOULDER_RADII)
    places = {"contact": in_contact, "shoulder": shoulder, "beyond": ~in_contact & ~shoulder}
    parts = {name: depth_mm((slopes - clipped) * where[..., None]) for name, where in places.items()}
    of_border_mm = -solve(boundary_term(true_mm))
    parts |= {
        "limit": depth_mm(clipped - truth),
        "border": -of_border_mm,
        "solver": depth_mm(truth) + of_border_mm - inner_mm,
    }
    deepest = np.unravel_index(inner_mm.argmax(), inner_mm.shape)
    largest = inner_mm[deepest]
    volume = np.maximum(inner_mm, 0).sum()
    return {
        "deepest_mm": float(largest),
        "depth": 100 * float(found_mm.max() / largest - 1),
        "volume": 100 * float(np.maximum(found_mm, 0).sum() / volume - 1),
        "mae_um": 1000 * float(np.abs(found_mm - inner_mm).mean()),
        "angle_rad": float(np.abs(np.arctan(slopes) - np.arctan(truth))[in_contact].mean()),
        **{name: 100 * float(error[deepest] / largest) for name, error in parts.items()},
    }
