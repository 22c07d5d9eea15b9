"""The gel's finite-element mesh: layers of hexahedra from the rigid skeleton up to the skin.

Node (k, j, i) is the k-th of the layers, the j-th along y and the i-th along x; layer 0 lies on the skeleton,
the last one is the skin. Lines of nodes run along the skin's normal, and thickness is measured along it.
Skeleton and rim (the outermost nodes along x and y) are fixed.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import MeshHex

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes
from fastac.sensor.mechanics.press import FemError

CORNERS = np.array([(1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)])
"""Offsets (i, j, k) of a hexahedron's nodes, in scikit-fem's order."""


@dataclass(frozen=True)
class GelMesh:
    """The nodes of the gel, which determine its hexahedra. Raises FemError for inverted elements."""

    nodes_mm: np.ndarray
    """(layers + 1, ny, nx, 3) float64, x, y, z of each node."""

    def __post_init__(self):
        layers, ny, nx = np.array(self.nodes_mm.shape[:3]) - (1, 0, 0)
        if layers < 1 or min(ny, nx) < 3:
            raise FemError(f"gel mesh: {layers} layers of {ny} x {nx} nodes: expected at least 1 of 3 x 3")
        volume = self.smallest_volume()
        if not volume > 0:
            raise FemError(
                f"gel mesh: an element's volume is {volume:.3g} of its box: thinner gel, or finer mesh"
            )

    def smallest_volume(self) -> float:
        """The smallest scalar triple product of the edges at an element's corner, relative to the largest.

        Not positive where an element is inverted.
        """
        p = self.nodes_mm
        products = []
        for corner in CORNERS:
            at, edges = tuple(slice(1, None) if c else slice(None, -1) for c in corner[::-1]), []
            for axis in range(3):
                to = list(at)
                to[2 - axis] = slice(None, -1) if corner[axis] else slice(1, None)
                edges.append((p[tuple(to)] - p[at]) * (-1 if corner[axis] else 1))
            products.append(np.einsum("...i,...i", edges[0], np.cross(edges[1], edges[2])))
        return float(np.min(products) / np.max(products))

    @cached_property
    def mesh(self) -> MeshHex:
        """The mesh for scikit-fem; node (k, j, i) has the number (k·ny + j)·nx + i."""
        layers, ny, nx = self.nodes_mm.shape[:3]
        number = np.arange(layers * ny * nx).reshape(layers, ny, nx)
        corners = [number[k : layers - 1 + k, j : ny - 1 + j, i : nx - 1 + i].ravel() for i, j, k in CORNERS]
        return MeshHex(self.nodes_mm.reshape(-1, 3).T.copy(), np.stack(corners))

    @property
    def skin_mm(self) -> np.ndarray:
        """(ny, nx, 3) nodes of the skin."""
        return self.nodes_mm[-1]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of free nodes of a layer along y and along x."""
        return self.nodes_mm.shape[1] - 2, self.nodes_mm.shape[2] - 2

    def areas_mm2(self) -> np.ndarray:
        """Area of the skin that belongs to each node, projected along z, (ny, nx)."""
        x, y = self.skin_mm[0, :, 0], self.skin_mm[:, 0, 1]
        return np.outer(*(np.convolve(np.diff(axis), (0.5, 0.5)) for axis in (y, x)))


def layered(x_mm, y_mm, z_mm, normals, thickness_mm, fractions) -> GelMesh:
    """The mesh of a gel under the skin z(x, y), with lines of nodes along the skin's normals.

    x_mm (nx,), y_mm (ny,) : the skin's grid, ascending; z_mm, thickness_mm : (ny, nx) or numbers
    normals : (ny, nx, 3) outward unit normals of the skin
    fractions : heights of the layers of nodes, from 0 at the skeleton to 1 at the skin, ascending
    """
    x, y = np.meshgrid(x_mm, y_mm)
    skin = np.stack([x, y, np.broadcast_to(z_mm, x.shape)], axis=-1)
    inwards = np.broadcast_to(thickness_mm, x.shape)[..., None] * normals
    below = 1 - np.asarray(fractions, float)
    return GelMesh(skin - below[:, None, None, None] * inwards)


def sensor_mesh(sensor: Sensor, elements: int = 40, layers: int = 4) -> GelMesh:
    """The gel of a scene's sensor, with `elements` elements along its longer side, square when seen along z.

    The nodes of the rim are at the outermost pixels. The thickness varies along y with the elastomer's
    `thickness_variation`. Layers get thinner towards the skin, where strains change fastest.
    """
    width, height = ((n - 1) * sensor.pitch_mm for n in (sensor.width_px, sensor.height_px))
    step = max(width, height) / elements
    x, y = (np.linspace(-side / 2, side / 2, max(round(side / step), 2) + 1) for side in (width, height))
    slopes, z = np.zeros((2, len(y), len(x))), np.zeros((len(y), len(x)))
    if sensor.geometry == "fingertip":
        a, b, c = sensor.ellipsoid.semi_axes_mm
        root = np.sqrt(1 - (x / a) ** 2 - (y[:, None] / b) ** 2)
        slopes = np.stack([-c * x / (a * a * root), -c * y[:, None] / (b * b * root)])
        z = c * (root - root[0, 0])
    along = np.linspace(-1, 1, len(y))[:, None]
    thickness = sensor.elastomer.thickness_mm * (1 + sensor.elastomer.thickness_variation * along)
    t = np.linspace(0, 1, layers + 1)
    return layered(x, y, z, normals_from_slopes(*slopes), thickness, t * (1.4 - 0.4 * t))
