"""Height maps of test objects like the paper's: a strawberry's skin, a fingerprint, an array of LED pads.

Heights are those of the lower surface, which faces the sensor; they are positive away from it. Sizes are
assumptions, typical of the real objects.
"""

import numpy as np

from fastac.sensor.mechanics.indenter import HeightMap
from fastac.store.kinds import Kinds

PITCH_MM = 0.05


def _grid(size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    axis = np.arange(-size_mm / 2, size_mm / 2 + PITCH_MM / 2, PITCH_MM)
    return np.meshgrid(axis, axis)


def _bowl(x: np.ndarray, y: np.ndarray, radius_x_mm: float, radius_y_mm: float) -> np.ndarray:
    """A paraboloid with these radii of curvature at its lowest point, (rows, columns) in mm."""
    return x**2 / (2 * radius_x_mm) + y**2 / (2 * radius_y_mm)


def strawberry(
    size_mm: float = 14.0, spacing_mm: float = 2.4, pit_mm: float = 0.35, pit_radius_mm: float = 0.45
) -> HeightMap:
    """A body with radii of curvature of 14 and 20 mm and pits, `pit_mm` deep, in a triangular lattice.

    A pit's profile is Gaussian; the seed in it fills a third of it.
    """
    x, y = _grid(size_mm)
    height = _bowl(x, y, 14.0, 20.0)
    rows = int(size_mm / spacing_mm) + 1
    for row in range(-rows, rows + 1):
        for column in range(-rows, rows + 1):
            centre_x = (column + 0.5 * (row % 2)) * spacing_mm
            centre_y = row * spacing_mm * np.sqrt(3) / 2
            distance2 = ((x - centre_x) ** 2 + (y - centre_y) ** 2) / pit_radius_mm**2
            height += pit_mm * (np.exp(-distance2 / 2) - np.exp(-4 * distance2) / 3)
    return HeightMap(height, PITCH_MM)


def fingerprint(size_mm: float = 14.0, period_mm: float = 0.8, ridge_mm: float = 0.12) -> HeightMap:
    """A fingertip with radii of curvature of 12 and 18 mm and ridges, `period_mm` apart, around a core."""
    x, y = _grid(size_mm)
    core = np.hypot(x, 0.7 * (y + 1.5))
    loop = core + 0.5 * np.sin(np.arctan2(y + 1.5, x) * 2)
    ridges = (1 - np.cos(2 * np.pi * loop / period_mm)) / 2
    return HeightMap(_bowl(x, y, 12.0, 18.0) + ridge_mm * ridges, PITCH_MM)


def led_pads(
    size_mm: float = 14.0, spacing_mm: float = 1.8, pad_mm: float = 0.9, height_mm: float = 0.25
) -> HeightMap:
    """A flat board with square pads raised by `height_mm`; their edges are 0.1 mm wide."""
    x, y = _grid(size_mm)

    def inside(along: np.ndarray) -> np.ndarray:
        """1 on a pad and 0 between pads, for coordinates along one axis; 0 is the centre of a pad."""
        from_middle = np.abs((along + spacing_mm / 2) % spacing_mm - spacing_mm / 2)
        return 1 / (1 + np.exp((from_middle - pad_mm / 2) / 0.025))

    return HeightMap(height_mm * (1 - inside(x) * inside(y)), PITCH_MM)


OBJECTS = Kinds("object", {"strawberry": strawberry, "fingerprint": fingerprint, "led_pads": led_pads})
"""Functions without further arguments that make an `Indenter`, by the objects' names."""
