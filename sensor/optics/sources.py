"""Positions of the four light sources, at the corners of a board behind the translucent skeleton."""

import numpy as np

from fastac.scenes.sensor_schema import Light

CORNERS = {"R": (1, 1), "G": (-1, -1), "B": (-1, 1), "NIR": (1, -1)}
"""Signs of x and y of each source: R opposite G, and B opposite NIR on the other diagonal."""


def source_mm(channel: str, light: Light) -> np.ndarray:
    """Position x, y, z (3,) of a channel's source in mm: below the skin, on a diagonal of the image."""
    side = light.distance_mm / np.sqrt(2)
    return np.array([CORNERS[channel][0] * side, CORNERS[channel][1] * side, -light.below_mm])
