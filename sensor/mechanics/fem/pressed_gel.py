"""The result of a press on the finite-element gel: displacements and forces of the skin's nodes.

F is the force of the skin on the indenter, F_x along u, F_y along v, F_z positive in compression, as in a
dataset.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RectBivariateSpline

from fastac.sensor.mechanics.fem.mesh import GelMesh
from fastac.sensor.mechanics.press import ContactError

REMAPPINGS = 8
"""Fixed-point iterations that find which point of the skin lies above a pixel; each reduces the error by a
factor of the order of the strain."""


@dataclass(frozen=True)
class GelContact:
    """An equilibrium of the gel with an indenter."""

    mesh: GelMesh
    displacement_mm: np.ndarray
    """(ny, nx, 3) displacement of each node of the skin along x, y, z; z is negative where pressed."""
    nodal_force_n: np.ndarray
    """(ny, nx, 3) force on each node of the skin."""
    in_contact: np.ndarray
    """(ny, nx) bool: nodes in contact."""
    sticking: np.ndarray
    """(ny, nx) bool: nodes in contact that did not slide in the last load step."""
    force_n: np.ndarray
    """(3,) force of the skin on the indenter along x, y, z."""
    first_touch_mm: float
    """z of the indenter's lowest point at first touch, which may lie between nodes."""
    indenter_displacement_mm: np.ndarray
    """(3,) displacement of the indenter from first touch along x, y, z."""

    def pressure_mpa(self) -> np.ndarray:
        """(ny, nx, 3) force on the indenter per area projected along z, at each node."""
        return -self.nodal_force_n / self.mesh.areas_mm2()[..., None]

    def displacement_at(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """(…, 3) displacement in mm of the points at x, y of the undeformed skin; a cubic spline between
        nodes."""
        return np.stack([self._spline(i).ev(y_mm, x_mm) for i in range(3)], axis=-1)

    def _spline(self, axis: int) -> RectBivariateSpline:
        skin = self.mesh.skin_mm
        return RectBivariateSpline(skin[:, 0, 1], skin[0, :, 0], self.displacement_mm[..., axis])

    def depth_at(self, x_mm: np.ndarray, y_mm: np.ndarray, rest_depth_mm) -> np.ndarray:
        """z of the deformed skin above x, y (…), in mm.

        rest_depth_mm : z of the undeformed skin as a function of x and y
        The point of the skin that has moved to x, y is found by fixed-point iteration.
        """
        splines = [self._spline(i) for i in range(3)]
        from_x, from_y = x_mm, y_mm
        for _ in range(REMAPPINGS):
            from_x, from_y = x_mm - splines[0].ev(from_y, from_x), y_mm - splines[1].ev(from_y, from_x)
        return rest_depth_mm(from_x, from_y) + splines[2].ev(from_y, from_x)

    def force_map_n(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """(H, W, 3) force of each pixel on the indenter; x_mm (W,) and y_mm (H,) are the pixels' centres.

        Each node's force is distributed by its bilinear shape function, normalised over the pixels, so that
        the sum is exactly the resultant. Raises ContactError where no pixel lies in the support of a loaded
        node's shape function.
        """
        skin, shared = self.mesh.skin_mm, []
        for nodes, pixels in ((skin[:, 0, 1], y_mm), (skin[0, :, 0], x_mm)):
            hats = np.stack([np.interp(pixels, nodes, row) for row in np.eye(len(nodes))], axis=-1)
            shared.append(hats / np.where(hats.sum(axis=0) > 0, hats.sum(axis=0), np.nan))
        rows, columns = self.in_contact.any(axis=1), self.in_contact.any(axis=0)
        force = -self.nodal_force_n[rows][:, columns]
        image = np.einsum("vj,jia,ui->vua", shared[0][:, rows], force, shared[1][:, columns])
        if not np.isfinite(image).all():
            raise ContactError("force map: pixels are farther apart than the mesh's nodes")
        return image
