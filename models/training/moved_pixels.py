"""Which pixels the pixel network is trained on: all that a press moves, and a share of the others."""

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.dataset import Dataset
from fastac.sensor.geometry import normals_from_slopes, rest_slopes

LEAST_CHANGE = 0.01
"""Change of a component of the unit normal beyond which a pixel has moved: slopes of about 0.01."""


def moved_or_chosen(data: Dataset, sensor: Sensor, share: float, seed: int) -> np.ndarray:
    """(frames, H, W) bool: the pixels whose normal differs from that of the skin at rest, and a random
    `share` of the others.

    The network minimises absolute errors, so that what noise hides is taken for what is most frequent. Where
    most pixels are at rest, that is no change of slope, and gentle slopes are found too small.
    """
    rest = normals_from_slopes(*rest_slopes(sensor)).astype(np.float32)
    rng = np.random.default_rng((seed, 1))  # other draws than those of training.normals_share
    return np.stack(
        [
            (np.abs(normals - rest).max(axis=-1) > LEAST_CHANGE) | (rng.random(rest.shape[:2]) < share)
            for normals in data.normals
        ]
    )
