"""The skin around a labelled contact circle: how far a pixel is from it, and what the skin is at rest."""

import numpy as np

from fastac.sensor.contact_circle import contact_circle
from fastac.sensor.dataset import Dataset


def circle_radii(data: Dataset, index: int) -> np.ndarray | None:
    """Distance of each pixel from the centre of a sample's contact circle, (H, W), in the circle's radii.

    None where the sample has no labelled circle.
    """
    circle = contact_circle(data, index)
    return None if circle is None else circle[0] / circle[1]


def at_rest(data: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Where the skin's normals at rest are known, (H, W) bool, and the normals, (H, W, 3).

    They are those of the first sample whose frame equals the background. Raises ValueError without one.
    """
    rests = data.at_rest
    if not rests.any():
        raise ValueError(
            "frames: none equals the background, and training.flat_beyond needs the skin at rest"
        )
    index = int(np.argmax(rests))
    known = np.ones(data.frames.shape[1:3], bool) if data.valid is None else data.valid[index]
    return known, data.normals[index].astype(np.float32)
