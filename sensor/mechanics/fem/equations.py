"""The conditions of contact and friction at each node, and their linearisation, compiled.

m nodes; each node's three directions are pressure and the two tangents. See sensor/mechanics/fem/contact.py.
"""

from typing import NamedTuple

import numpy as np
from numba import njit


class Conditions(NamedTuple):
    """What each node does, by the augmented forces of Alart and Curnier, and how far it is from it."""

    in_contact: np.ndarray
    """(m,) bool."""
    sticking: np.ndarray
    """(m,) bool: in_contact, and its trial traction is within the friction's bound."""
    direction: np.ndarray
    """(m, 2) of the trial traction, zero if there is none."""
    share: np.ndarray
    """(m,) the bound over the trial traction."""
    tension_n: float
    """Largest pull at a node, and any force at one that does not touch."""
    penetration_mm: float
    separation_mm: float
    """Largest gap, of either sign, of a touching node."""
    slip_mm: float
    """Largest slip of a sticking node along a tangent."""
    sliding_error_n: float
    """Largest difference of a sliding node's traction from μ n along `direction`."""


@njit(cache=True, nogil=True)
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
    """Of gaps (m,), slips (m, 2) since the last step, forces (m, 3) in N and `scale` (m, 3) in N/mm."""
    return Conditions(*_conditions(gap_mm, slip_mm, force, scale, friction))


@njit(cache=True, nogil=True)
def superposed(compliance, rows, forces):
    """Displacement (n,) by `forces` at `rows` of a symmetric compliance (n, n), whose rows are not copied."""
    moved = np.zeros(compliance.shape[1])
    for k in range(len(rows)):
        moved += forces[k] * compliance[rows[k]]
    return moved


@njit(cache=True, nogil=True)
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
    """Matrix (n, n) and right side (n,) of the forces of `nodes` and the indenter's ways, n = 3 · nodes + f.

    compliance : (3m, 3m) in the nodes' own directions `frame` (m, 3, 3)
    slip_mm : (m, 2) of which a sticking node keeps
    axes, spring : (f, 3), (f,) along which the force is given; those forces' places on the right side are 0
    given : (3,) the indenter's way along its other axes

    Touching nodes have no gap. Sticking ones do not slip; of sliding ones the traction is μ n along
    `direction`, the direction's change included.
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


@njit(cache=True, nogil=True)
def _slide(matrix, side, first, scale, friction, direction, share):
    """Put a node's law of sliding in place of its two equations of no slip, in the rows after `first`."""
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
