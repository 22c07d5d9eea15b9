"""The finite-element gel of a fingertip: presses by rigid indenters, with friction and under given loads.

F is the skin's force on the indenter, F_x along u, F_y along v, F_z positive in compression, as in a dataset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from fastac.scene import Elastomer, Sensor
from sensor.elastomer import ContactError
from sensor.fem import cached_unit_compliance
from sensor.fem_contact import GAP_TOLERANCE_MM, ContactProblem, Load, NotConvergedError, State
from sensor.fem_mesh import GelMesh, sensor_mesh
from sensor.indenter import Indenter

STEEPEST = 4.0
"""Slope of an indenter beyond which it is a side, not a face: small displacements say nothing there."""
FINER = 4
"""Points along each side of an element that are searched for the first touch."""
REMAPPINGS = 8
"""Fixed-point iterations to find which point of the skin lies above a pixel; each is a factor of strain."""


@dataclass(frozen=True)
class GelContact:
    mesh: GelMesh
    displacement_mm: np.ndarray
    """(ny, nx, 3) x, y, z displacement of each node of the skin; pressing is negative z."""
    nodal_force_n: np.ndarray
    """(ny, nx, 3) force on each node of the skin."""
    touching: np.ndarray
    """(ny, nx) bool."""
    sticking: np.ndarray
    """(ny, nx) bool: touching, and at rest on the indenter in the last step of the load."""
    force_n: np.ndarray
    """(3,) the skin's force on the indenter."""
    first_touch_mm: float
    """z of the indenter's lowest point when it first touches the skin, which may be between nodes."""
    way_mm: np.ndarray
    """(3,) how far the indenter moved from there."""

    def pressure_mpa(self) -> np.ndarray:
        """(ny, nx, 3) force on the indenter per area seen along z, at each node."""
        return -self.nodal_force_n / self.mesh.areas_mm2()[..., None]

    def displacement_at(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """(…, 3) displacement of the skin's points that lie at x, y at rest; cubic between nodes."""
        return np.stack([self._spline(i).ev(y_mm, x_mm) for i in range(3)], axis=-1)

    def _spline(self, axis: int) -> RectBivariateSpline:
        skin = self.mesh.skin_mm
        return RectBivariateSpline(skin[:, 0, 1], skin[0, :, 0], self.displacement_mm[..., axis])

    def depth_at(self, x_mm: np.ndarray, y_mm: np.ndarray, rest_depth_mm) -> np.ndarray:
        """z of the deformed skin above x, y (…), in mm.

        rest_depth_mm : function of x and y. Which point of the skin has moved to x, y is found by iteration.
        """
        splines = [self._spline(i) for i in range(3)]
        from_x, from_y = x_mm, y_mm
        for _ in range(REMAPPINGS):
            from_x, from_y = x_mm - splines[0].ev(from_y, from_x), y_mm - splines[1].ev(from_y, from_x)
        return rest_depth_mm(from_x, from_y) + splines[2].ev(from_y, from_x)

    def force_map_n(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """(H, W, 3) force on the indenter of each pixel; x_mm (W,) and y_mm (H,) are the pixels' centres.

        Each node's force is shared out by its bilinear hat, so that the sum is the resultant exactly. Raises
        ContactError where no pixel lies under a loaded node's hat.
        """
        skin, shared = self.mesh.skin_mm, []
        for nodes, pixels in ((skin[:, 0, 1], y_mm), (skin[0, :, 0], x_mm)):
            hats = np.stack([np.interp(pixels, nodes, row) for row in np.eye(len(nodes))], axis=-1)
            shared.append(hats / np.where(hats.sum(axis=0) > 0, hats.sum(axis=0), np.nan))
        rows, columns = self.touching.any(axis=1), self.touching.any(axis=0)
        force = -self.nodal_force_n[rows][:, columns]
        image = np.einsum("vj,jia,ui->vua", shared[0][:, rows], force, shared[1][:, columns])
        if not np.isfinite(image).all():
            raise ContactError("force map: pixels are farther apart than the mesh's nodes")
        return image


class Gel:
    """The elastomer of one sensor, with its compliance computed once; presses on it are independent."""

    def __init__(self, mesh: GelMesh, elastomer: Elastomer, cache: Path | str, *, progress: bool = True):
        self.mesh, self.elastomer = mesh, elastomer
        unit = cached_unit_compliance(mesh, elastomer.poisson_ratio, cache, progress=progress)
        self._unit = unit
        y, x = mesh.skin_mm[:, 0, 1], mesh.skin_mm[0, :, 0]
        fine = [np.interp(np.arange(0, len(n) - 1 + 1e-9, 1 / FINER), np.arange(len(n)), n) for n in (y, x)]
        self._fine_y_mm, self._fine_x_mm = fine
        self._fine_z_mm = RectBivariateSpline(y, x, mesh.skin_mm[..., 2])(*fine)

    @classmethod
    def of_sensor(cls, sensor: Sensor, cache: Path | str, *, elements=40, layers=4, progress=True) -> "Gel":
        return cls(sensor_mesh(sensor, elements, layers), sensor.elastomer, cache, progress=progress)

    def press(
        self,
        indenter: Indenter,
        x_mm: float,
        y_mm: float,
        *,
        load_n: float,
        friction: float = 0.0,
        tangential_n: tuple[float, float] | None = None,
        steps: int = 4,
    ) -> GelContact:
        """Press an indenter with its axis at x, y down until F_z = load_n; then, if asked, drag it sideways.

        It is led straight down. With `tangential_n` it is then dragged against that direction, and held
        across it, until the force along (F_x, F_y) = tangential_n has that size, F_z being kept. Each
        phase is divided into `steps`, for friction remembers. Raises ContactError for an indenter beside the
        skin or on its rim, and for a load that friction, the indenter's face or the thickness cannot carry.
        """
        drags = () if tangential_n is None else (tangential_n,)
        keys = {"load_n": load_n, "friction": friction, "drags_n": drags, "steps": steps}
        contact = self.presses(indenter, x_mm, y_mm, **keys)[-1]
        if isinstance(contact, ContactError):
            raise contact
        return contact

    def presses(
        self,
        indenter: Indenter,
        x_mm: float,
        y_mm: float,
        *,
        load_n: float,
        friction: float = 0.0,
        drags_n: Sequence[tuple[float, float]] = (),
        steps: int = 4,
    ) -> list[GelContact | ContactError]:
        """`press` without a drag, then each of `drags_n` (F_x, F_y) from there, as `press` would alone.

        In place of a drag that cannot be carried is its error. Raises ContactError as `press` does where the
        vertical load cannot.
        """
        where = f"{type(indenter).__name__} at x = {x_mm:g} mm, y = {y_mm:g} mm with {load_n:g} N"
        if not load_n > 0:
            raise ContactError(f"{where}: expected a load of more than 0")
        if not 0 <= friction <= 10:
            raise ContactError(f"{where}: friction = {friction:g}: expected 0 to 10")
        touch_mm = self._first_touch_mm(indenter, x_mm, y_mm, where)
        problem, candidates, other_gap = self._problem(indenter, x_mm, y_mm, touch_mm, friction, where)
        down = self._press_down(problem, load_n, steps, where)
        contact = self._contact(problem, down, candidates, touch_mm)
        self._check(contact, other_gap, where)
        found: list[GelContact | ContactError] = [contact]
        for drag in drags_n:
            dragged = f"{where} and {drag[0]:g}, {drag[1]:g} N sideways"
            try:
                state = self._drag(problem, down, load_n, drag, steps, dragged)
                contact = self._contact(problem, state, candidates, touch_mm)
                self._check(contact, other_gap, dragged)
                found.append(contact)
            except ContactError as error:
                found.append(error)
        return found

    def _first_touch_mm(self, indenter: Indenter, x_mm: float, y_mm: float, where: str) -> float:
        x, y = self._fine_x_mm, self._fine_y_mm
        if not (x[0] <= x_mm <= x[-1] and y[0] <= y_mm <= y[-1]):
            raise ContactError(f"{where}: expected inside the skin")
        touch = self._fine_z_mm - indenter.surface(*np.meshgrid(x - x_mm, y - y_mm))[0]
        return float(touch.max())

    def _problem(self, indenter, x_mm, y_mm, touch_mm, friction, where):
        """The contact problem of the nodes that may touch, which those are, and the gap of the others."""
        skin = self.mesh.skin_mm
        z, p, q = indenter.surface(skin[..., 0] - x_mm, skin[..., 1] - y_mm)
        if not np.isfinite(z).any():
            raise ContactError(f"{where}: smaller than the mesh's elements")
        gap = np.maximum(z + touch_mm - skin[..., 2], 0)
        inner = (slice(1, -1), slice(1, -1))
        flat, slopes = gap[inner].ravel(), np.hypot(p, q)[inner].ravel()
        candidates = np.flatnonzero((flat < self.elastomer.thickness_mm) & (slopes < STEEPEST))
        other_gap = gap.copy()
        row, column = np.unravel_index(candidates, self.mesh.shape)
        other_gap[row + 1, column + 1] = np.inf
        if not len(candidates):
            raise ContactError(f"{where}: the indenter touches nothing but the fixed rim")
        outwards = np.stack([-p[inner].ravel(), -q[inner].ravel(), np.ones_like(flat)], axis=-1)[candidates]
        normals = outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
        dofs = (3 * candidates[:, None] + np.arange(3)).ravel()
        compliance = self._unit[np.ix_(dofs, dofs)] / self.elastomer.modulus_mpa
        problem = ContactProblem(compliance, flat[candidates] * normals[:, 2], normals, friction)
        return problem, candidates, other_gap

    @staticmethod
    def _press_down(problem: ContactProblem, load_n: float, steps: int, where: str) -> State:
        down = Load(np.eye(3), np.array([False, False, True]), np.array([0.0, 0.0, load_n]))
        try:
            return problem.follow(problem.rest(), down, steps)
        except NotConvergedError:
            raise ContactError(f"{where}: no equilibrium: more than the contact can carry") from None

    @staticmethod
    def _drag(problem: ContactProblem, start: State, load_n: float, drag_n, steps: int, where: str) -> State:
        size = np.hypot(*drag_n)
        if size == 0:
            return start
        along = np.array([*drag_n, 0.0]) / size
        axes = np.stack([along, np.cross((0, 0, 1), along), (0, 0, 1)])
        load = Load(axes, np.array([True, False, True]), np.array([size, 0.0, load_n]))
        try:
            state = problem.follow(start, load, steps)
        except NotConvergedError:
            raise ContactError(f"{where}: no equilibrium: more than the contact can carry") from None
        if not state.sticking.any():
            raise ContactError(f"{where}: slides, a friction of {problem.friction:g} is too little")
        return state

    def _contact(self, problem: ContactProblem, state: State, candidates, touch_mm: float) -> GelContact:
        ny, nx = self.mesh.shape
        inner = np.zeros((ny * nx, 3))
        inner[candidates] = problem.forces_n(state)
        loaded = candidates[state.force[:, 0] > 0]
        dofs = (3 * loaded[:, None] + np.arange(3)).ravel()
        moved = inner[loaded].ravel() @ self._unit[dofs] / self.elastomer.modulus_mpa
        fields = [moved.reshape(ny, nx, 3), inner.reshape(ny, nx, 3)]
        for chosen in (state.force[:, 0] > 0, state.sticking):
            mask = np.zeros(ny * nx, bool)
            mask[candidates[chosen]] = True
            fields.append(mask.reshape(ny, nx))
        whole = [np.pad(field, ((1, 1), (1, 1), (0, 0))[: field.ndim]) for field in fields]
        return GelContact(self.mesh, *whole, problem.resultant_n(state), touch_mm, state.way_mm)

    def _check(self, contact: GelContact, other_gap: np.ndarray, where: str) -> None:
        """Raise ContactError where nodes beside the candidates for contact overlap, or the gel is thin."""
        overlap = other_gap + contact.way_mm[2] - contact.displacement_mm[..., 2] < -GAP_TOLERANCE_MM
        if overlap[1:-1, 1:-1].any():
            raise ContactError(f"{where}: the skin reaches the indenter's side")
        if overlap.any():
            raise ContactError(f"{where}: the contact reaches the fixed rim")
        sunk, thickness = -contact.way_mm[2], self.elastomer.thickness_mm
        if sunk > thickness:
            raise ContactError(f"{where}: sinks {sunk:.2f} mm into {thickness:g} mm of elastomer")
