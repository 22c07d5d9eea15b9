"""The contact solver, checked against conditions, closed forms and a solve of the whole mesh."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.sparse import block_array, csr_array
from scipy.sparse.linalg import splu

from fastac.scenes.sensor_schema import Elastomer, Sensor
from fastac.sensor.mechanics.fem import compliance
from fastac.sensor.mechanics.fem.gel import Gel
from fastac.sensor.mechanics.fem.mesh import layered, sensor_mesh
from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.mechanics.layer import layer_compliance

CURVED = Sensor(geometry="fingertip", height_px=33, width_px=33, pitch_mm=0.5)
HERTZ = Elastomer(modulus_mpa=0.2, poisson_ratio=0.3, thickness_mm=10.0, thickness_variation=0)
BALL_MM, LOAD_N = 8.0, 0.05
STIFFNESS = HERTZ.modulus_mpa / (1 - HERTZ.poisson_ratio**2)
RADIUS = (3 * LOAD_N * BALL_MM / 2 / (4 * STIFFNESS)) ** (1 / 3)
"""Hertz: a³ = 3FR / 4E*."""


@pytest.fixture(scope="module")
def curved(tmp_path_factory):
    mesh = sensor_mesh(CURVED, elements=12, layers=3)
    return Gel(mesh, CURVED.elastomer, tmp_path_factory.mktemp("cache"), progress=False)


@pytest.fixture(scope="module")
def thick(tmp_path_factory):
    """A thick, wide, flat gel: a fine mesh under the contact, and elements growing by one half outwards."""
    grown = np.cumsum(0.25 * 1.5 ** np.arange(1, 7))
    x = np.concatenate([-1.25 - grown[::-1], np.linspace(-1.25, 1.25, 11), 1.25 + grown])
    below = np.concatenate([[0], np.cumsum(0.25 * 1.5 ** np.arange(8))])
    mesh = layered(x, x, 0.0, np.array([0.0, 0, 1]), below[-1], 1 - below[::-1] / below[-1])
    layer = HERTZ.model_copy(update={"thickness_mm": float(below[-1])})
    return Gel(mesh, layer, tmp_path_factory.mktemp("cache"), progress=False)


@pytest.mark.full
def test_hertz(thick):
    contact = thick.press(Ball(BALL_MM), 0.0, 0.0, load_n=LOAD_N, steps=1)
    areas, skin = thick.mesh.areas_mm2(), thick.mesh.skin_mm
    assert np.sqrt(areas[contact.in_contact].sum() / np.pi) == pytest.approx(RADIUS, rel=0.1)
    peak = 3 * LOAD_N / (2 * np.pi * RADIUS**2)
    pressure = contact.pressure_mpa()[..., 2]
    assert pressure.max() == pytest.approx(peak, rel=0.03)
    r = np.hypot(skin[..., 0], skin[..., 1])
    hertz = peak * np.sqrt(np.maximum(1 - (r / RADIUS) ** 2, 0))
    assert (np.abs(pressure - hertz) * areas).sum() < 0.1 * LOAD_N
    h = thick.elastomer.thickness_mm

    def lost(x):
        return 1 - layer_compliance(np.array([x / h]), thick.elastomer)[0] * STIFFNESS * x / h / 2

    base = LOAD_N / (np.pi * STIFFNESS * h) * quad(lost, 1e-9, 60)[0]
    assert -contact.indenter_displacement_mm[2] == pytest.approx(RADIUS**2 / (BALL_MM / 2) - base, rel=0.03)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_cattaneo_and_mindlin(thick, share):
    """Tangential load share·μ·F: displacement 3μF(2−ν)/(16Ga)·(1−(1−share)^⅔), sticking radius
    a·(1−share)^⅓ (Johnson, "Contact Mechanics", 7.2)."""
    friction, nu = 0.6, HERTZ.poisson_ratio
    size = share * friction * LOAD_N
    contact = thick.press(
        Ball(BALL_MM), 0.0, 0.0, load_n=LOAD_N, friction=friction, tangential_n=(0.0, -size)
    )
    shear = HERTZ.modulus_mpa / (2 * (1 + nu))
    way = 3 * friction * LOAD_N * (2 - nu) / (16 * shear * RADIUS) * (1 - (1 - share) ** (2 / 3))
    assert contact.indenter_displacement_mm[1] == pytest.approx(way, rel=0.1)
    stuck = np.sqrt(thick.mesh.areas_mm2()[contact.sticking].sum() / np.pi)
    assert stuck == pytest.approx(RADIUS * (1 - share) ** (1 / 3), rel=0.15)
    np.testing.assert_allclose(contact.force_n, (0, -size, LOAD_N), atol=1e-7)


def whole_mesh_contact(gel, touch_mm, indenter_displacement_mm, *, stuck):
    """The skin under a ball at (1, −1) displaced by `indenter_displacement_mm` from first touch, solved with
    Lagrange multipliers on the whole mesh.

    Returns displacements, the resultant on the skin, and which nodes touch.
    """
    mesh, layer = gel.mesh, gel.elastomer
    dofs = compliance.free_dofs(mesh).ravel()
    matrix = compliance.stiffness(mesh, layer.modulus_mpa, layer.poisson_ratio)[dofs][:, dofs]
    skin = mesh.skin_mm[1:-1, 1:-1].reshape(-1, 3)
    z, p, q = Ball(5.0).surface(skin[:, 0] - 1, skin[:, 1] + 1)
    gap = z + touch_mm - skin[:, 2]
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    first = len(dofs) - 3 * len(skin)
    active = gap < 0.3
    for _ in range(30):
        nodes = np.flatnonzero(active)
        rows = np.eye(3)[None].repeat(len(nodes), 0) if stuck else normals[nodes, None]
        # The gap closes where n·u = n·way + gap; along the tangents a stuck node goes with the ball.
        sides = np.einsum("nab,b->na", rows, indenter_displacement_mm)
        if stuck:
            unit = normals[nodes] / np.linalg.norm(normals[nodes], axis=1, keepdims=True)
            sides = sides + gap[nodes, None] * unit[:, 2:] * unit
        else:
            sides = sides + gap[nodes, None]
        columns = (first + 3 * nodes[:, None] + np.arange(3)).repeat(rows.shape[1], 0)
        at = np.arange(len(columns))[:, None].repeat(3, 1)
        constraint = csr_array(
            (rows.reshape(-1, 3).ravel(), (at.ravel(), columns.ravel())), shape=(len(columns), len(dofs))
        )
        solver = splu(block_array([[matrix, constraint.T], [constraint, None]]).tocsc())
        found = solver.solve(np.concatenate([np.zeros(len(dofs)), sides.ravel()]))
        moved = found[first : len(dofs)].reshape(-1, 3)
        multiplier = found[len(dofs) :].reshape(len(nodes), -1)
        push = (multiplier * (normals[nodes] if stuck else 1)).sum(axis=1)
        overlap = gap + ((indenter_displacement_mm - moved) * normals).sum(axis=1) < -1e-10
        before, active = active, overlap & np.isfinite(gap)
        active[nodes[push > 0]] = True
        if np.array_equal(before, active):
            force = -(constraint.T @ multiplier.ravel())[first:].reshape(-1, 3)
            return moved.reshape(*mesh.shape, 3), force.sum(axis=0), active.reshape(mesh.shape)
    raise AssertionError("no equilibrium")


@pytest.mark.parametrize(("friction", "stuck"), [(0.0, False), (10.0, True)])
def test_equals_an_independent_solve_of_the_whole_mesh(curved, friction, stuck):
    contact = curved.press(Ball(5.0), 1.0, -1.0, load_n=0.8, friction=friction, steps=1)
    moved, force, active = whole_mesh_contact(
        curved, contact.first_touch_mm, contact.indenter_displacement_mm, stuck=stuck
    )
    np.testing.assert_array_equal(contact.in_contact[1:-1, 1:-1], active)
    np.testing.assert_allclose(contact.displacement_mm[1:-1, 1:-1], moved, atol=1e-7)
    np.testing.assert_allclose(-force, contact.force_n, atol=1e-6)


@pytest.mark.parametrize(
    ("friction", "tangential"),
    [(0.0, None), *((mu, load) for mu in (0.4, 1.5) for load in (None, (0.2, 0.0), (-0.1, 0.12)))],
)
def test_conditions_of_contact_and_friction(curved, friction, tangential):
    contact = curved.press(Ball(5.0), 1.0, -1.0, load_n=0.8, friction=friction, tangential_n=tangential)
    skin = curved.mesh.skin_mm
    z, p, q = Ball(5.0).surface(skin[..., 0] - 1, skin[..., 1] + 1)
    near = np.isfinite(z)
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    free_gap = np.where(near, z + contact.first_touch_mm - skin[..., 2], 0)
    gap = free_gap * normals[..., 2] + (
        (contact.indenter_displacement_mm - contact.displacement_mm) * normals
    ).sum(axis=-1)
    pressure = -(contact.nodal_force_n * normals).sum(axis=-1)
    traction = contact.nodal_force_n + pressure[..., None] * normals
    assert gap[near].min() > -1e-7
    assert np.abs(gap[contact.in_contact]).max() < 1e-7
    assert pressure.min() >= -1e-8
    np.testing.assert_array_equal(pressure[~contact.in_contact], 0)
    size, bound = np.linalg.norm(traction, axis=-1), friction * pressure
    assert (size - bound).max() < 1e-7
    sliding = contact.in_contact & ~contact.sticking
    np.testing.assert_allclose(size[sliding], bound[sliding], atol=1e-7)
    assert (size < bound)[contact.sticking].all()
    np.testing.assert_allclose(-contact.nodal_force_n.sum(axis=(0, 1)), contact.force_n)
    assert contact.force_n[2] == pytest.approx(0.8)
    if tangential:
        along = np.array(tangential) / np.hypot(*tangential)
        assert contact.force_n[:2] @ along == pytest.approx(np.hypot(*tangential))
        assert contact.indenter_displacement_mm[:2] @ along < 0, "dragged against the force on the indenter"
        assert contact.indenter_displacement_mm[:2] @ (-along[1], along[0]) == pytest.approx(0, abs=1e-12)
