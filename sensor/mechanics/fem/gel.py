"""The finite-element gel of a fingertip: presses by rigid indenters to prescribed loads, with friction.

F is the force of the skin on the indenter, F_x along u, F_y along v, F_z positive in compression, as in a
dataset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from fastac.scenes.sensor_schema import Elastomer, Sensor
from fastac.sensor.mechanics.fem.compliance import cached_unit_compliance
from fastac.sensor.mechanics.fem.contact import (
    GAP_TOLERANCE_MM,
    ContactProblem,
    Load,
    NotConvergedError,
    State,
)
from fastac.sensor.mechanics.fem.equations import superposed
from fastac.sensor.mechanics.fem.mesh import GelMesh, sensor_mesh
from fastac.sensor.mechanics.fem.pressed_gel import GelContact
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.press import ContactError

MAX_FACE_SLOPE = 4.0
"""Slope beyond which a point of the indenter belongs to its side, where no contact is modelled: the
small-displacement assumption fails there."""
SEARCH_POINTS_PER_ELEMENT = 4
"""Points along each side of an element at which the first touch is searched."""


@dataclass(frozen=True)
class ContactSetup:
    """An indenter placed above the skin, at first touch: the contact problem of the nodes that it may
    touch."""

    indenter: Indenter
    x_mm: float
    y_mm: float
    problem: ContactProblem
    candidates: np.ndarray
    """(m,) indices of the problem's nodes among the skin's free nodes, row by row."""
    other_gap_mm: np.ndarray
    """(ny, nx) gap of the skin's other nodes at first touch, infinite at the candidates."""
    first_touch_mm: float
    """z of the indenter's lowest point at first touch."""


class Gel:
    """The elastomer of one sensor, with its compliance computed once; presses on it are independent."""

    def __init__(self, mesh: GelMesh, elastomer: Elastomer, store: Path | str, *, progress: bool = True):
        self.mesh, self.elastomer = mesh, elastomer
        unit = cached_unit_compliance(mesh, elastomer.poisson_ratio, store, progress=progress)
        self._unit = unit
        y, x = mesh.skin_mm[:, 0, 1], mesh.skin_mm[0, :, 0]
        fine = [
            np.interp(np.arange(0, len(n) - 1 + 1e-9, 1 / SEARCH_POINTS_PER_ELEMENT), np.arange(len(n)), n)
            for n in (y, x)
        ]
        self._fine_y_mm, self._fine_x_mm = fine
        self._fine_z_mm = RectBivariateSpline(y, x, mesh.skin_mm[..., 2])(*fine)

    @classmethod
    def of_sensor(cls, sensor: Sensor, store: Path | str, *, elements=40, layers=4, progress=True) -> "Gel":
        return cls(sensor_mesh(sensor, elements, layers), sensor.elastomer, store, progress=progress)

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
        """Press an indenter at (x_mm, y_mm) down until F_z = load_n, then apply a tangential load if given.

        The indenter moves straight down. With `tangential_n` it is then moved against that direction, without
        moving across it, until the force along it equals (F_x, F_y) = tangential_n, at constant F_z. Each
        phase has `steps` load steps, since friction depends on the path. Raises ContactError for an indenter
        beside the skin or on its rim, and for a load that friction, the indenter's face or the gel's
        thickness cannot carry.
        """
        drags = () if tangential_n is None else (tangential_n,)
        keys = {"load_n": load_n, "friction": friction, "tangential_loads_n": drags, "steps": steps}
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
        tangential_loads_n: Sequence[tuple[float, float]] = (),
        steps: int = 4,
    ) -> list[GelContact | ContactError]:
        """The vertical press, then each of `tangential_loads_n`, (F_x, F_y), applied to it separately.

        Each result equals that of `press` with this tangential load. A tangential load that cannot be carried
        has its error in the list; raises ContactError as `press` where the vertical load cannot.
        """
        where = f"{type(indenter).__name__} at x = {x_mm:g} mm, y = {y_mm:g} mm with {load_n:g} N"
        if not load_n > 0:
            raise ContactError(f"{where}: expected a load of more than 0")
        setup = self._contact_setup(indenter, x_mm, y_mm, friction, self.elastomer.thickness_mm, where)
        problem = setup.problem
        down = self._press_down(problem, load_n, steps, where)
        found: list[GelContact | ContactError] = [self.contact(setup, down, where)]
        for drag in tangential_loads_n:
            dragged = f"{where} and {drag[0]:g}, {drag[1]:g} N sideways"
            try:
                state = self._drag(problem, down, load_n, drag, steps, dragged)
                found.append(self.contact(setup, state, dragged))
            except ContactError as error:
                found.append(error)
        return found

    def _first_touch_mm(self, indenter: Indenter, x_mm: float, y_mm: float, where: str) -> float:
        x, y = self._fine_x_mm, self._fine_y_mm
        if not (x[0] <= x_mm <= x[-1] and y[0] <= y_mm <= y[-1]):
            raise ContactError(f"{where}: expected inside the skin")
        touch = self._fine_z_mm - indenter.surface(*np.meshgrid(x - x_mm, y - y_mm))[0]
        return float(touch.max())

    def set_up_contact(
        self, indenter: Indenter, x_mm: float, y_mm: float, *, friction: float, reach_mm: float
    ) -> ContactSetup:
        """The contact problem of an indenter with its axis at (x_mm, y_mm), to which loads can be applied.

        reach_mm : the largest approach to be expected; nodes with a larger gap at first touch are left out
        Raises ContactError for an indenter beside the skin or on its rim.
        """
        where = f"{type(indenter).__name__} at x = {x_mm:g} mm, y = {y_mm:g} mm"
        return self._contact_setup(
            indenter, x_mm, y_mm, friction, min(reach_mm, self.elastomer.thickness_mm), where
        )

    def _contact_setup(self, indenter, x_mm, y_mm, friction, reach_mm, where) -> ContactSetup:
        if not 0 <= friction <= 10:
            raise ContactError(f"{where}: friction = {friction:g}: expected 0 to 10")
        touch_mm = self._first_touch_mm(indenter, x_mm, y_mm, where)
        skin = self.mesh.skin_mm
        z, p, q = indenter.surface(skin[..., 0] - x_mm, skin[..., 1] - y_mm)
        if not np.isfinite(z).any():
            raise ContactError(f"{where}: smaller than the mesh's elements")
        gap = np.maximum(z + touch_mm - skin[..., 2], 0)
        inner = (slice(1, -1), slice(1, -1))
        flat, slopes = gap[inner].ravel(), np.hypot(p, q)[inner].ravel()
        candidates = np.flatnonzero((flat < reach_mm) & (slopes < MAX_FACE_SLOPE))
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
        return ContactSetup(indenter, x_mm, y_mm, problem, candidates, other_gap, touch_mm)

    @staticmethod
    def _press_down(problem: ContactProblem, load_n: float, steps: int, where: str) -> State:
        down = Load(np.eye(3), np.array([False, False, True]), np.array([0.0, 0.0, load_n]))
        try:
            return problem.apply_load(problem.unloaded(), down, steps)
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
            state = problem.apply_load(start, load, steps)
        except NotConvergedError:
            raise ContactError(f"{where}: no equilibrium: more than the contact can carry") from None
        if not state.sticking.any():
            raise ContactError(f"{where}: slides, a friction of {problem.friction:g} is too little")
        return state

    def contact(self, setup: ContactSetup, state: State, where: str) -> GelContact:
        """Displacements and forces of the whole skin in a state of the setup's problem; `where` begins
        errors.

        Raises ContactError where the indenter penetrates nodes outside the problem, or sinks deeper than the
        elastomer is thick.
        """
        problem, candidates = setup.problem, setup.candidates
        ny, nx = self.mesh.shape
        inner = np.zeros((ny * nx, 3))
        inner[candidates] = problem.forces_n(state)
        loaded = candidates[state.force[:, 0] > 0]
        dofs = (3 * loaded[:, None] + np.arange(3)).ravel()
        moved = superposed(self._unit, dofs, inner[loaded].ravel()) / self.elastomer.modulus_mpa
        fields = [moved.reshape(ny, nx, 3), inner.reshape(ny, nx, 3)]
        for chosen in (state.force[:, 0] > 0, state.sticking):
            mask = np.zeros(ny * nx, bool)
            mask[candidates[chosen]] = True
            fields.append(mask.reshape(ny, nx))
        whole = [np.pad(field, ((1, 1), (1, 1), (0, 0))[: field.ndim]) for field in fields]
        touch_mm, indenter_displacement_mm = setup.first_touch_mm, state.indenter_displacement_mm
        contact = GelContact(
            self.mesh, *whole, problem.resultant_n(state), touch_mm, indenter_displacement_mm
        )
        self._check(contact, setup.other_gap_mm, where)
        return contact

    def _check(self, contact: GelContact, other_gap: np.ndarray, where: str) -> None:
        overlap = (
            other_gap + contact.indenter_displacement_mm[2] - contact.displacement_mm[..., 2]
            < -GAP_TOLERANCE_MM
        )
        if overlap[1:-1, 1:-1].any():
            raise ContactError(f"{where}: the skin reaches the indenter's side")
        if overlap.any():
            raise ContactError(f"{where}: the contact reaches the fixed rim")
        sunk, thickness = -contact.indenter_displacement_mm[2], self.elastomer.thickness_mm
        if sunk > thickness:
            raise ContactError(f"{where}: sinks {sunk:.2f} mm into {thickness:g} mm of elastomer")
