"""The skin around a labelled contact circle: how far a pixel is from it, and what the skin is at rest."""

import numpy as np

from fastac.sensor.dataset import Dataset


def circle_radii(data: Dataset, index: int) -> np.ndarray | None:
    """Distance of each pixel from the centre of a sample's contact circle, (H, W), in the circle's radii.

    None where the sample has no labelled circle.
    """
    circle = data.indenter or {}
    if "center_px" not in circle or "radius_px" not in circle:
        return None
    (centre_u, centre_v), radius = circle["center_px"][index], circle["radius_px"][index]
    if not np.isfinite(radius):
        return None
    v, u = np.indices(data.frames.shape[1:3])
    return np.hypot(u - centre_u, v - centre_v) / radius


def at_rest(data: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Where the skin's normals at rest are known, (H, W) bool, and the normals, (H, W, 3).

    They are those of the first sample whose frame equals the background. Raises ValueError without one.
    """
    for index, frame in enumerate(data.frames):
        if np.array_equal(frame, data.background):
            known = np.ones(frame.shape[:2], bool) if data.valid is None else data.valid[index]
            return known, data.normals[index].astype(np.float32)
    raise ValueError("frames: none equals the background, and training.flat_beyond needs the skin at rest")
