"""Circles around contacts, as labels of recorded ball presses."""

import numpy as np

from fastac.sensor.samples import Dataset


def contact_circle(data: Dataset, index: int) -> tuple[np.ndarray, float] | None:
    """Distance of each pixel from the centre of a sample's contact circle, (H, W), and its radius, in px.

    None where the sample has no labelled circle.
    """
    circle = data.indenter or {}
    if "center_px" not in circle or "radius_px" not in circle:
        return None
    (centre_u, centre_v), radius = circle["center_px"][index], circle["radius_px"][index]
    if not np.isfinite(radius):
        return None
    v, u = np.indices(data.frames.shape[1:3])
    return np.hypot(u - centre_u, v - centre_v), float(radius)
