"""A record as LeRobot's tactile proposals have it: points [dx, dy, dz, Fx, Fy, Fz] and a wrench.

Axes: x along a row of the image, y down its columns, z into the skin, so that dz and Fz are positive where an
object presses. What the stream does not find is NaN: dx, dy and torques always, Fx and Fy of
sensors that find the force along z alone.
"""

from dataclasses import dataclass

import numpy as np

from .messages import About, Record

POINT_COLUMNS = ("dx", "dy", "dz", "Fx", "Fy", "Fz")
"""Of a point: displacement in mm, force in N."""
WRENCH_COLUMNS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Forces in N, torques in N·mm."""
AXES = ("x", "y", "z")


def wrench(record: Record) -> np.ndarray:
    """(6,) float32: the force on the whole skin in N; torques are NaN, because a stream has none."""
    found = np.full(len(WRENCH_COLUMNS), np.nan, np.float32)
    for axis, force_n in record.force_n.items():
        found[AXES.index(axis)] = force_n
    return found


@dataclass(frozen=True)
class Taxels:
    """A grid of rows × columns of equal parts of the skin, as equal as whole pixels allow.

    Raises ValueError where the grid has more rows or columns than the depth has pixels.
    """

    about: About
    grid: tuple[int, int]

    def __post_init__(self):
        inner = self.inner_px
        if not all(0 < parts <= pixels for parts, pixels in zip(self.grid, inner, strict=True)):
            raise ValueError(
                f"grid = {list(self.grid)}: the sensor has {inner[0]} × {inner[1]} px without its rim"
            )

    @property
    def inner_px(self) -> tuple[int, int]:
        """Rows and columns of depth and force map, which are without the image's rim."""
        rim_rows, rim_columns = self.about.depth_origin_px
        return self.about.height_px - 2 * rim_rows, self.about.width_px - 2 * rim_columns

    @property
    def count(self) -> int:
        """Number of taxels."""
        return self.grid[0] * self.grid[1]

    @property
    def edges(self) -> list[np.ndarray]:
        """For rows and for columns the pixel at which each part begins, and the end."""
        return [
            np.round(np.linspace(0, pixels, parts + 1)).astype(int)
            for pixels, parts in zip(self.inner_px, self.grid, strict=True)
        ]

    @property
    def positions_mm(self) -> np.ndarray:
        """(taxels, 2) float32: x and y of the taxels' centres from the centre of the image, row by row."""
        y, x = (
            (self.about.pitch_mm * ((edges[:-1] + edges[1:]) / 2 - edges[-1] / 2)).astype(np.float32)
            for edges in self.edges
        )
        return np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=1)

    def points(self, record: Record, rest_mm: np.ndarray | None) -> np.ndarray:
        """(taxels, 6) float32, row by row: mean displacement in mm and sum of the force in N on each taxel.

        rest_mm : (H - 2, W - 2), the depth of the untouched skin; without it dz is NaN
        """
        found = np.full((self.count, len(POINT_COLUMNS)), np.nan, np.float32)
        depth_mm, force_map_n = record.arrays.get("depth_mm"), record.arrays.get("force_map_n")
        if depth_mm is not None and rest_mm is not None:
            pixels = np.multiply.outer(*(np.diff(edges) for edges in self.edges))
            found[:, 2] = (self._sums(rest_mm - depth_mm) / pixels).ravel()
        if force_map_n is not None:
            for axis, image in zip(self.about.force_axes, force_map_n, strict=True):
                found[:, 3 + AXES.index(axis)] = self._sums(image).ravel()
        return found

    def _sums(self, image: np.ndarray) -> np.ndarray:
        """(rows, columns) float64: the sum over each taxel's pixels."""
        rows, columns = self.edges
        return np.add.reduceat(
            np.add.reduceat(image.astype(np.float64), rows[:-1], axis=0), columns[:-1], axis=1
        )
