"""The contact and friction conditions at each node, and their linearisation for Newton's method, compiled.

Of m nodes; each node has three directions, the normal and two tangents. Augmented-Lagrangian form of Alart
and Curnier, Comput. Methods Appl. Mech. Eng. 92 (1991) 353; see sensor/mechanics/fem/contact.py.
"""

from typing import NamedTuple

import numpy as np

from fastac.store.compiled_loops import compiled


class Conditions(NamedTuple):
    """The contact state of each node, from the augmented forces of Alart and Curnier, and the residuals."""

    in_contact: np.ndarray
    """(m,) bool: the augmented normal force is compressive."""
    sticking: np.ndarray
    """(m,) bool: in contact, with a trial traction below the friction bound μ n."""
    direction: np.ndarray
    """(m, 2) direction of the trial traction, a unit vector; zero where there is none."""
    share: np.ndarray
    """(m,) ratio of the friction bound to the trial traction's magnitude."""
    tension_n: float
    """Residual: largest tensile normal force of a node, or largest force of a node that is not in contact."""
    penetration_mm: float
    """Residual: largest penetration of a node."""
    separation_mm: float
    """Residual: largest |gap| of a node in contact."""
    slip_mm: float
    """Residual: largest slip of a sticking node along a tangent."""
    sliding_error_n: float
    """Residual: largest deviation of a sliding node's traction from μ n along `direction`."""


@compiled()
def _conditions(gap_mm, slip_mm, force, scale, friction):
    count = len(gap_mm)
    in_contact, sticking = np.zeros((2, count), np.bool_)
    direction, share = np.zeros((count, 2)), np.zeros(count)
    pull = overlap = opened = slipped = off = 0.0
    for i in range(count):
        pressed = force[i, 0] - scale[i, 0] * gap_mm[i]
        stiffness = (scale[i, 1] + scale[i, 2]) / 2
        trial_1 = force[i, 1] - stiffness * slip_mm[i, 0]
        trial_2 = force[i, 2] - stiffness * slip_mm[i, 1]
        size, bound = np.sqrt(trial_1 * trial_1 + trial_2 * trial_2), friction * max(pressed, 0.0)
        in_contact[i] = pressed > 0
        sticking[i] = in_contact[i] and size < bound
        if size > 0:
            direction[i, 0], direction[i, 1] = trial_1 / size, trial_2 / size
            share[i] = bound / size
        pull, overlap = max(pull, -force[i, 0]), max(overlap, -gap_mm[i])
        if not in_contact[i]:
            pull = max(pull, abs(force[i, 0]), abs(force[i, 1]), abs(force[i, 2]))
            continue
        opened = max(opened, abs(gap_mm[i]))
        for axis in range(2):
            if sticking[i]:
                slipped = max(slipped, abs(slip_mm[i, axis]))
            else:
                off = max(off, abs(force[i, 1 + axis] - friction * force[i, 0] * direction[i, axis]))
    return in_contact, sticking, direction, share, pull, overlap, opened, slipped, off


def conditions(gap_mm, slip_mm, force, scale, friction: float) -> Conditions:
    """The conditions at m nodes.

    gap_mm : (m,) gaps; slip_mm : (m, 2) slips since the last load step; force : (m, 3) in N
    scale : (m, 3) augmentation parameters in N/mm; friction : Coulomb's coefficient μ
    """
    return Conditions(*_conditions(gap_mm, slip_mm, force, scale, friction))


@compiled()
def superposed(compliance, rows, forces):
    """Displacement (n,) under `forces` (k,) at the degrees of freedom `rows` (k,).

    compliance : (n, n), symmetric

    The sum runs over the rows in place, so that no part of the large matrix is copied.
    """
    moved = np.zeros(compliance.shape[1])
    for k in range(len(rows)):
        moved += forces[k] * compliance[rows[k]]
    return moved


@compiled()
def linearised(
    compliance,
    frame,
    gap_mm,
    slip_mm,
    scale,
    friction,
    nodes,
    sticking,
    direction,
    share,
    axes,
    spring,
    given,
):
    """Matrix (n, n) and right-hand side (n,) for the forces of `nodes` and the indenter's displacements along
    f force-controlled axes, n = 3 · nodes + f.

    compliance : (3m, 3m) in the nodes' own directions `frame` (m, 3, 3)
    slip_mm : (m, 2) slip at the beginning of the load step, which sticking nodes keep
    axes, spring : (f, 3) and (f,), the force-controlled axes and their springs' stiffness; the right-hand
        side of their equations is left 0 for the caller
    given : (3,) the indenter's displacement along its other axes, in mm

    The gap of nodes in contact is zero. Sticking nodes do not slip; the traction of sliding ones is μ n along
    `direction`, whose derivative is included.
    """
    count, forces = len(nodes), 3 * len(nodes)
    matrix, side = np.zeros((forces + len(axes), forces + len(axes))), np.zeros(forces + len(axes))
    for a in range(count):
        node = nodes[a]
        for k in range(3):
            row = matrix[3 * a + k]
            for b in range(count):
                for c in range(3):
                    row[3 * b + c] = compliance[3 * node + k, 3 * nodes[b] + c]
            for f in range(len(axes)):
                along = -(axes[f] * frame[node, k]).sum()
                row[forces + f] = matrix[forces + f, 3 * a + k] = along
            start = -gap_mm[node] if k == 0 else slip_mm[node, k - 1]
            side[3 * a + k] = start + (frame[node, k] * given).sum()
        if not sticking[node]:
            _slide(matrix, side, 3 * a, scale[node], friction, direction[node], share[node])
    for f in range(len(axes)):
        matrix[forces + f, forces + f] = -spring[f]
    return matrix, side


@compiled()
def _slide(matrix, side, first, scale, friction, direction, share):
    """Replace a node's two no-slip equations, rows `first` + 1 and + 2, by the linearised law of sliding."""
    across = share * (np.eye(2) - np.outer(direction, direction))
    stiff = (scale[1] + scale[2]) / 2 * across
    one, other = matrix[first + 1], matrix[first + 2]
    for column in range(len(one)):
        before, beside = one[column], other[column]
        one[column] = stiff[0, 0] * before + stiff[0, 1] * beside
        other[column] = stiff[1, 0] * before + stiff[1, 1] * beside
    before, beside = side[first + 1], side[first + 2]
    for k in range(2):
        side[first + 1 + k] = stiff[k, 0] * before + stiff[k, 1] * beside
        matrix[first + 1 + k, first] -= friction * direction[k]
        matrix[first + 1 + k, first + 1 + k] += 1
        for c in range(2):
            matrix[first + 1 + k, first + 1 + c] -= across[k, c]
