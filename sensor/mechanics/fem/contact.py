"""Unilateral contact with Coulomb friction between the skin's nodes and a rigid indenter.

At each node: no pull and no overlap (force n ≥ 0, gap ≥ 0, one of them zero), and |t| ≤ μ n, where the node
either sticks to the indenter or slides, with t against the slip. The indenter moves without turning; along
each of its axes either its way is given, or its force, or the force of a spring that leads it, so that loads
are reached exactly. Small displacements:
the gap of a node changes along the indenter's normal at first touch, with its way relative to the indenter.

Each load step is solved by a semismooth Newton method on the compliance (Alart and Curnier, Comput. Methods
Appl. Mech. Eng. 92 (1991) 353; Hüeber, Stadler and Wohlmuth, SIAM J. Sci. Comput. 30 (2008) 572). A step that
does not converge is halved.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from fastac.sensor.mechanics.fem.equations import Conditions, conditions, linearised

GAP_TOLERANCE_MM = 1e-8
FORCE_TOLERANCE = 1e-8
"""Largest error of a force that is given, relative to the largest nodal force."""
MAX_ITERATIONS = 40
MAX_HALVINGS = 6
DIVERGED = 1e9
"""N or mm, beyond which an iteration does not come back."""
SEEDS = 5
"""Nodes that first touch."""


class NotConvergedError(ArithmeticError):
    """No equilibrium was found: the load is most likely more than friction, or the contact, can carry."""


@dataclass(frozen=True)
class Load:
    """What is given along the indenter's three axes, the rows of `axes`, unit vectors."""

    axes: np.ndarray
    force_controlled: np.ndarray
    """(3,) bool: whether the force is given along an axis; else the way."""
    value: np.ndarray
    """(3,) the skin's force on the indenter in N, or the indenter's way from first touch in mm."""
    spring_n_per_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) ≥ 0: along an axis with one, what is given is the force less this times the way, as where the
    indenter hangs on a spring. A load that friction cannot carry then has an equilibrium too: it slides."""


@dataclass(frozen=True)
class State:
    force: np.ndarray
    """(m, 3) nodal forces in N: pressure, and traction along both tangents."""
    indenter_displacement_mm: np.ndarray
    """(3,) of the indenter from first touch, along x, y and z."""
    slip_mm: np.ndarray
    """(m, 2) of each node relative to the indenter, from first touch."""
    sticking: np.ndarray
    """(m,) bool: in contact and did not slide in the last step."""


class ContactProblem:
    """m nodes that may touch.

    compliance_mm_per_n : (3m, 3m), x, y, z of each node
    gap_mm : (m,) ≥ 0 at first touch, along `normals` (m, 3), unit vectors from the skin to the indenter
    """

    def __init__(self, compliance_mm_per_n, gap_mm, normals, friction: float):
        first = np.stack([normals[:, 2], np.zeros(len(normals)), -normals[:, 0]], axis=-1)
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        self.frame = np.stack([-normals, first, np.cross(normals, first)], axis=1)
        """(m, 3, 3): the directions of a node's three forces on the skin."""
        m = len(gap_mm)
        local = np.einsum("iab,ibn->ian", self.frame, compliance_mm_per_n.reshape(m, 3, -1))
        local = np.einsum("xjd,jcd->xjc", local.reshape(3 * m, m, 3), self.frame)
        self.compliance = local.reshape(3 * m, 3 * m)
        self.gap_mm, self.friction = np.asarray(gap_mm, float), friction
        self.scale = 1 / self.compliance.diagonal().reshape(m, 3)

    def unloaded(self) -> State:
        m = len(self.gap_mm)
        return State(np.zeros((m, 3)), np.zeros(3), np.zeros((m, 2)), np.zeros(m, bool))

    def forces_n(self, state: State) -> np.ndarray:
        """Nodal forces on the skin, (m, 3) along x, y, z."""
        return np.einsum("ia,iab->ib", state.force, self.frame)

    def resultant_n(self, state: State) -> np.ndarray:
        """The skin's force on the indenter, (3,)."""
        return -self.forces_n(state).sum(axis=0)

    def apply_load(self, start: State, load: Load, steps: int) -> State:
        """From one equilibrium to another, the load changing evenly in `steps` steps or more.

        Raises NotConvergedError where a step of 1/64 of the given ones still has no solution.
        """
        before = self._given(load, self.resultant_n(start), start.indenter_displacement_mm)
        state, done, size = start, 0.0, 1 / steps
        while done < 1 - 1e-12:
            share = min(done + size, 1.0)
            value = before + share * (load.value - before)
            try:
                state = self._step(state, replace(load, value=value))
            except NotConvergedError:
                size /= 2
                if size < 1 / steps / 2**MAX_HALVINGS:
                    raise
                continue
            done = share
        return state

    @staticmethod
    def _given(load: Load, resultant: np.ndarray, way: np.ndarray) -> np.ndarray:
        """What `load.value` gives, (3,), of a resultant and a way."""
        along = load.axes @ way
        return np.where(load.force_controlled, load.axes @ resultant - load.spring_n_per_mm * along, along)

    def _relative(self, force: np.ndarray, way: np.ndarray) -> np.ndarray:
        """The skin's movement relative to the indenter in each node's frame, (m, 3)."""
        return (self.compliance @ force.ravel()).reshape(-1, 3) - self.frame @ way

    def _step(self, start: State, load: Load) -> State:
        force, way = start.force, start.indenter_displacement_mm
        in_contact = force[:, 0] > 0
        if not in_contact.any():
            in_contact[np.argsort(self.gap_mm, kind="stable")[:SEEDS]] = True
            free = np.zeros_like(in_contact)
            none = np.zeros_like(start.slip_mm)
            force, way = self._newton(start, load, in_contact, free, none, np.zeros(len(force)))
        elif self.friction and not start.sticking.any():
            # From where all slide, with no spring, no way is the solution: begin as if the load held them.
            none = np.zeros_like(start.slip_mm)
            force, way = self._newton(start, load, in_contact, in_contact, none, np.zeros(len(force)))
        for _ in range(MAX_ITERATIONS):
            relative = self._relative(force, way)
            gap, slip = self.gap_mm + relative[:, 0], relative[:, 1:] - start.slip_mm
            found = conditions(gap, slip, force, self.scale, self.friction)
            if self._settled(load, force, way, found):
                return State(force, way, relative[:, 1:], found.sticking)
            if not found.in_contact.any():
                raise NotConvergedError
            nodes = found.in_contact, found.sticking, found.direction, found.share
            force, way = self._newton(start, load, *nodes)
        raise NotConvergedError

    def _settled(self, load: Load, force: np.ndarray, way: np.ndarray, found: Conditions) -> bool:
        """Whether every condition of contact, friction and load holds."""
        small = FORCE_TOLERANCE * np.abs(force).max()
        if not (small > 0 and found.tension_n <= small and found.sliding_error_n <= small):
            return False
        if max(found.penetration_mm, found.separation_mm, found.slip_mm) > GAP_TOLERANCE_MM:
            return False
        given = self._given(load, -np.einsum("ia,iab->b", force, self.frame), way)
        return bool(
            (np.abs(given - load.value) <= np.where(load.force_controlled, small, GAP_TOLERANCE_MM)).all()
        )

    def _newton(self, start, load, in_contact, sticking, direction, share):
        """New forces and way: the equations of the nodes' present conditions, linearised, and of the load."""
        nodes, force_controlled = np.flatnonzero(in_contact), np.flatnonzero(load.force_controlled)
        given = load.axes[~load.force_controlled].T @ load.value[~load.force_controlled]
        axes, spring = load.axes[force_controlled], load.spring_n_per_mm[force_controlled]
        state = nodes, sticking, direction, share
        model = self.compliance, self.frame, self.gap_mm, start.slip_mm, self.scale, self.friction
        matrix, side = linearised(*model, *state, axes, spring, given)
        side[3 * len(nodes) :] = load.value[force_controlled]
        # LAPACK's columns are the rows here.
        factors, pivots, failed = dgetrf(matrix.T, overwrite_a=True)
        if failed:
            raise NotConvergedError
        found, _ = dgetrs(factors, pivots, side, trans=1, overwrite_b=True)
        if not np.abs(found).max() < DIVERGED:
            raise NotConvergedError
        force = np.zeros_like(start.force)
        force[nodes] = found[: 3 * len(nodes)].reshape(-1, 3)
        return force, given + axes.T @ found[3 * len(nodes) :]
