"""Circles around contacts, as labels of recorded ball presses."""

import numpy as np

from fastac.sensor.samples import Dataset

ROUNDING_PX = 1e-6
"""By so much a circle that ends at the photograph's rim may seem to reach beyond it."""


def _circle(data: Dataset, index: int) -> tuple[np.ndarray, float] | None:
    """Centre (u, v) and radius of a sample's contact circle, px; None where it has none."""
    known = data.indenter or {}
    if "center_px" not in known or "radius_px" not in known or not np.isfinite(known["radius_px"][index]):
        return None
    return known["center_px"][index], float(known["radius_px"][index])


def contact_circle(data: Dataset, index: int) -> tuple[np.ndarray, float] | None:
    """Distance of each pixel from the centre of a sample's contact circle, (H, W), and its radius, in px.

    None where the sample has no labelled circle.
    """
    circle = _circle(data, index)
    if circle is None:
        return None
    (centre_u, centre_v), radius = circle
    v, u = np.indices(data.frames.shape[1:3])
    return np.hypot(u - centre_u, v - centre_v), radius


def is_whole(data: Dataset, index: int) -> bool:
    """Whether a sample has a contact circle that lies within its photograph.

    Of another one a part was not seen, nor is the depth at the photograph's rim that of the skin at rest,
    which solvers take it for.
    """
    circle = _circle(data, index)
    if circle is None:
        return False
    centre_px, radius_px = circle
    size_px = np.array(data.frames.shape[2:0:-1])
    photograph_px = np.array(data.photograph_px or data.frames.shape[1:3])[::-1]
    covered_px = photograph_px / (photograph_px / size_px).max()
    beyond_px = np.abs(centre_px - (size_px - 1) / 2) + radius_px - covered_px / 2
    return bool((beyond_px <= ROUNDING_PX).all())
