"""Unilateral contact with Coulomb friction between the skin's nodes and a rigid indenter.

At each node the normal force n ≥ 0 and the gap ≥ 0, and one of them is zero (Signorini); the traction t has
|t| ≤ μ n, and the node either sticks to the indenter or slides with t against the slip (Coulomb). The
indenter moves without turning. Along each of its axes the load prescribes either its displacement, or its
force, or the force of a spring by which it is moved. Displacements are assumed small: the gap of a node
changes by its displacement relative to the indenter, along the indenter's normal at first touch.

Each load step is solved by a semismooth Newton method on the skin's compliance (Alart and Curnier, Comput.
Methods Appl. Mech. Eng. 92 (1991) 353; Hüeber, Stadler and Wohlmuth, SIAM J. Sci. Comput. 30 (2008) 572). A
step that does not converge is halved.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from fastac.sensor.mechanics.fem.equations import Conditions, conditions, linearised

GAP_TOLERANCE_MM = 1e-8
FORCE_TOLERANCE = 1e-8
"""Largest error of a prescribed force, relative to the largest nodal force."""
MAX_ITERATIONS = 40
MAX_HALVINGS = 6
DIVERGED = 1e9
"""Magnitude, in N or mm, beyond which an iteration is taken as divergent."""
INITIAL_CONTACT_NODES = 5
"""Number of nodes assumed in contact in the first iteration: those with the smallest gaps."""


class NotConvergedError(ArithmeticError):
    """No equilibrium was found: most likely the load exceeds what friction, or the contact, can carry."""


@dataclass(frozen=True)
class Load:
    """The prescribed force or displacement of the indenter along three orthogonal axes."""

    axes: np.ndarray
    """(3, 3), an axis a row: orthogonal unit vectors."""
    force_controlled: np.ndarray
    """(3,) bool: whether the force is prescribed along an axis; otherwise the displacement."""
    value: np.ndarray
    """(3,) force of the skin on the indenter in N, or displacement of the indenter from first touch in mm."""
    spring_n_per_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) ≥ 0: stiffness of a spring that holds the indenter along a force-controlled axis. `value` is then
    the force less stiffness times displacement, so that a load beyond friction has an equilibrium too: the
    indenter slides until the spring carries the rest."""


@dataclass(frozen=True)
class State:
    """An equilibrium of a contact problem with m nodes."""

    force: np.ndarray
    """(m, 3) nodal forces in N: normal force, and traction along both tangents."""
    indenter_displacement_mm: np.ndarray
    """(3,) displacement of the indenter from first touch, along x, y and z."""
    slip_mm: np.ndarray
    """(m, 2) tangential displacement of each node relative to the indenter, from first touch."""
    sticking: np.ndarray
    """(m,) bool: nodes in contact that did not slide in the last load step."""

    @property
    def sticking_share(self) -> float:
        """Of the nodes in contact, the share that did not slide in the last load step; 0 without contact."""
        contact = self.force[:, 0] > 0
        return float((self.sticking & contact).sum() / max(contact.sum(), 1))


class ContactProblem:
    """The contact of m nodes of the skin with a rigid indenter.

    compliance_mm_per_n : (3m, 3m), x, y, z of each node
    gap_mm : (m,) ≥ 0, gap of each node at first touch, along its normal
    normals : (m, 3) unit vectors from the skin to the indenter
    friction : Coulomb's coefficient μ ≥ 0
    """

    def __init__(self, compliance_mm_per_n, gap_mm, normals, friction: float):
        first = np.stack([normals[:, 2], np.zeros(len(normals)), -normals[:, 0]], axis=-1)
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        self.frame = np.stack([-normals, first, np.cross(normals, first)], axis=1)
        """(m, 3, 3): directions of a node's three forces on the skin, inward normal and two tangents, as
        rows."""
        m = len(gap_mm)
        local = np.einsum("iab,ibn->ian", self.frame, compliance_mm_per_n.reshape(m, 3, -1))
        local = np.einsum("xjd,jcd->xjc", local.reshape(3 * m, m, 3), self.frame)
        self.compliance = local.reshape(3 * m, 3 * m)
        self.gap_mm, self.friction = np.asarray(gap_mm, float), friction
        self.scale = 1 / self.compliance.diagonal().reshape(m, 3)

    def unloaded(self) -> State:
        """The state at first touch, without forces."""
        m = len(self.gap_mm)
        return State(np.zeros((m, 3)), np.zeros(3), np.zeros((m, 2)), np.zeros(m, bool))

    def forces_n(self, state: State) -> np.ndarray:
        """Nodal forces on the skin in N, (m, 3) along x, y, z."""
        return np.einsum("ia,iab->ib", state.force, self.frame)

    def resultant_n(self, state: State) -> np.ndarray:
        """Force of the skin on the indenter in N, (3,) along x, y, z."""
        return -self.forces_n(state).sum(axis=0)

    def apply_load(self, start: State, load: Load, steps: int) -> State:
        """The equilibrium under `load`, reached from the equilibrium `start` in `steps` equal load steps.

        Steps that do not converge are halved; raises NotConvergedError where one of 1/64 of the original
        size does not either. Friction makes the result depend on `start` and on the path.
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
    def _given(load: Load, resultant: np.ndarray, moved_mm: np.ndarray) -> np.ndarray:
        """The quantities that `load.value` prescribes, (3,), from a resultant and a displacement."""
        along = load.axes @ moved_mm
        return np.where(load.force_controlled, load.axes @ resultant - load.spring_n_per_mm * along, along)

    def _relative(self, force: np.ndarray, moved_mm: np.ndarray) -> np.ndarray:
        """Displacement of the skin relative to the indenter in each node's frame, (m, 3) in mm."""
        return (self.compliance @ force.ravel()).reshape(-1, 3) - self.frame @ moved_mm

    def _step(self, start: State, load: Load) -> State:
        force, moved_mm = start.force, start.indenter_displacement_mm
        in_contact = force[:, 0] > 0
        if not in_contact.any():
            in_contact[np.argsort(self.gap_mm, kind="stable")[:INITIAL_CONTACT_NODES]] = True
            free = np.zeros_like(in_contact)
            none = np.zeros_like(start.slip_mm)
            force, moved_mm = self._newton(start, load, in_contact, free, none, np.zeros(len(force)))
        elif self.friction and not start.sticking.any():
            # Where every node slides and no spring holds the indenter, the equations do not fix its
            # displacement: start from all nodes sticking.
            none = np.zeros_like(start.slip_mm)
            force, moved_mm = self._newton(start, load, in_contact, in_contact, none, np.zeros(len(force)))
        for _ in range(MAX_ITERATIONS):
            relative = self._relative(force, moved_mm)
            gap, slip = self.gap_mm + relative[:, 0], relative[:, 1:] - start.slip_mm
            found = conditions(gap, slip, force, self.scale, self.friction)
            if self._settled(load, force, moved_mm, found):
                return State(force, moved_mm, relative[:, 1:], found.sticking)
            if not found.in_contact.any():
                raise NotConvergedError
            nodes = found.in_contact, found.sticking, found.direction, found.share
            force, moved_mm = self._newton(start, load, *nodes)
        raise NotConvergedError

    def _settled(self, load: Load, force: np.ndarray, moved_mm: np.ndarray, found: Conditions) -> bool:
        """Whether every condition of contact, friction and load holds."""
        small = FORCE_TOLERANCE * np.abs(force).max()
        if not (small > 0 and found.tension_n <= small and found.sliding_error_n <= small):
            return False
        if max(found.penetration_mm, found.separation_mm, found.slip_mm) > GAP_TOLERANCE_MM:
            return False
        given = self._given(load, -np.einsum("ia,iab->b", force, self.frame), moved_mm)
        return bool(
            (np.abs(given - load.value) <= np.where(load.force_controlled, small, GAP_TOLERANCE_MM)).all()
        )

    def _newton(self, start, load, in_contact, sticking, direction, share):
        """One Newton step: nodal forces (m, 3) and the indenter's displacement (3,) that solve the linearised
        contact conditions of the nodes together with the load's equations."""
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
