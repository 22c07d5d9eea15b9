"""Contact conditions of single nodes against values by hand, and the linearisation against differences."""

import numpy as np
import pytest

from fastac.sensor.mechanics.fem.equations import conditions, linearised, superposed

FRICTION = 0.5
SCALE = np.array([[2.0, 3.0, 5.0]])


def one(gap_mm, slip_mm, force):
    return conditions(np.array([gap_mm]), np.array([slip_mm]), np.array([force]), SCALE, FRICTION)


def test_a_node_above_the_indenter_is_free():
    found = one(0.1, [0.0, 0.0], [0.0, 0.0, 0.0])
    assert not found.in_contact[0]
    assert found[4:] == (0, 0, 0, 0, 0)


def test_what_a_free_node_bears_or_pulls_and_overlaps_is_an_error():
    assert one(0.1, [0.0, 0.0], [0.1, -0.15, 0.0]).tension_n == 0.15
    assert one(0.1, [0.0, 0.0], [-0.3, 0.0, 0.0]).tension_n == 0.3
    assert one(-0.2, [0.0, 0.0], [0.0, 0.0, 0.0]).penetration_mm == 0.2


def test_a_node_sticks_below_the_friction_s_bound():
    found = one(0.0, [0.0, 1e-3], [1.0, 0.3, 0.0])
    assert found.in_contact[0]
    assert found.sticking[0]
    assert found.slip_mm == 1e-3
    assert found.sliding_error_n == 0


def test_a_node_slides_beyond_it():
    """Trial traction (0.3, 0) − 4 N/mm · (−0.1, 0.1) mm = (0.7, −0.4) N, above the friction bound of 0.5
    N."""
    found = one(0.0, [-0.1, 0.1], [1.0, 0.3, 0.0])
    size = np.hypot(0.7, 0.4)
    assert found.in_contact[0]
    assert not found.sticking[0]
    np.testing.assert_allclose(found.direction[0], [0.7 / size, -0.4 / size])
    assert found.share[0] == pytest.approx(0.5 / size)
    assert found.sliding_error_n == pytest.approx(max(abs(0.3 - 0.5 * 0.7 / size), 0.5 * 0.4 / size))


def test_no_traction_has_no_direction():
    found = one(0.0, [0.0, 0.0], [0.0, 0.0, 0.0])
    assert not found.direction.any()
    assert found.share[0] == 0


@pytest.fixture
def nodes():
    """Four nodes in arbitrary directions, a compliance, and forces near which the laws are linearised."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(12, 12))
    frame = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    force = rng.normal(size=(4, 3))
    force[:, 0] = rng.uniform(0.5, 1, 4)
    return root @ root.T + np.eye(12), frame, force, rng


def test_linearised_laws_are_the_derivatives(nodes):
    """Gap and slip of sticking nodes; for sliding nodes, traction less μ n along the trial traction."""
    compliance, frame, force, rng = nodes
    gap, slip_before = rng.uniform(size=4), rng.normal(size=(4, 2))
    scale = 1 / compliance.diagonal().reshape(4, 3)
    stiffness = scale[:, 1:].mean(axis=1, keepdims=True)
    sticking = np.array([True, False, False, True])
    axes = np.eye(3)

    def laws(x):
        forces, way = x[:12].reshape(4, 3), x[12:]
        moved = (compliance @ x[:12]).reshape(4, 3) - frame @ way
        slip = moved[:, 1:] - slip_before
        trial = forces[:, 1:] - stiffness * slip
        along = trial / np.linalg.norm(trial, axis=1, keepdims=True)
        off = forces[:, 1:] - FRICTION * forces[:, :1] * along
        given = -np.einsum("ia,iab->b", forces, frame) - 7.0 * way
        tangential = np.where(sticking[:, None], slip, off)
        return np.concatenate([np.column_stack([gap + moved[:, 0], tangential]).ravel(), given])

    x = np.concatenate([force.ravel(), [0.1, 0.2, -0.3]])
    slip = (compliance @ x[:12]).reshape(4, 3)[:, 1:] - (frame @ x[12:])[:, 1:] - slip_before
    found = conditions(np.zeros(4), slip, force, scale, FRICTION)
    matrix, side = linearised(
        *(compliance, frame, gap, slip_before, scale, FRICTION, np.arange(4), sticking),
        *(found.direction, found.share, axes, np.full(3, 7.0), np.zeros(3)),
    )
    step = 1e-6
    numerical = np.stack([(laws(x + step * e) - laws(x - step * e)) / (2 * step) for e in np.eye(15)], axis=1)
    np.testing.assert_allclose(matrix, numerical, atol=1e-6)
    still = np.r_[0, 1, 2, 9, 10, 11]  # whose laws are linear
    np.testing.assert_allclose((matrix @ x - side)[still], laws(x)[still], atol=1e-12)


def test_only_the_nodes_that_touch_and_the_forced_axes_are_unknown(nodes):
    compliance, frame, _, _ = nodes
    none = np.zeros((4, 2))
    matrix, side = linearised(
        *(compliance, frame, np.full(4, 0.25), none, np.ones((4, 3)), 0.0, np.array([2]), np.ones(4, bool)),
        *(none, np.zeros(4), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.array([0.1, 0.0, 0.0])),
    )
    assert matrix.shape == (4, 4)
    np.testing.assert_array_equal(matrix[:3, :3], compliance[6:9, 6:9])
    np.testing.assert_array_equal(matrix[3, :3], -frame[2, :, 2])
    np.testing.assert_allclose(side, [*(frame[2] @ [0.1, 0, 0] - [0.25, 0, 0]), 0])


def test_superposed():
    rng = np.random.default_rng(2)
    compliance = rng.normal(size=(9, 9))
    rows, forces = np.array([1, 4]), np.array([2.0, -3.0])
    np.testing.assert_allclose(superposed(compliance, rows, forces), forces @ compliance[rows])
