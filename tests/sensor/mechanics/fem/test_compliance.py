import numpy as np
import pytest
from scipy.integrate import quad
from scipy.sparse.linalg import splu

from fastac.scenes.sensor_schema import Elastomer, Sensor
from fastac.sensor.mechanics.fem import compliance as fem
from fastac.sensor.mechanics.fem.mesh import GelMesh, layered, sensor_mesh
from fastac.sensor.mechanics.layer import layer_compliance

CURVED = Sensor(geometry="fingertip", height_px=33, width_px=33, pitch_mm=0.5)


def small():
    return sensor_mesh(CURVED, elements=8, layers=3)


def distorted(seed=0):
    nodes = small().nodes_mm
    return GelMesh(nodes + np.random.default_rng(seed).uniform(-0.2, 0.2, nodes.shape))


def test_patch_test():
    """A linear displacement is in equilibrium in a distorted mesh, and its energy is that of its strain."""
    mesh, e, nu = distorted(), 0.4, 0.45
    matrix = fem.stiffness(mesh, e, nu)
    gradient = np.array([[0.1, 0.3, -0.2], [0.05, -0.2, 0.4], [0.3, 0.1, 0.2]])
    moved = (mesh.nodes_mm.reshape(-1, 3) @ gradient.T).ravel()
    force = (matrix @ moved).reshape(mesh.nodes_mm.shape)
    np.testing.assert_allclose(force[1:-1, 1:-1, 1:-1], 0, atol=1e-12)
    strain = (gradient + gradient.T) / 2
    lame, shear = e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))
    density = lame * np.trace(strain) ** 2 + 2 * shear * (strain**2).sum()
    volume = fem.Basis(mesh.mesh, fem.ElementHex0(), intorder=4).dx.sum()
    assert moved @ matrix @ moved == pytest.approx(density * volume, rel=1e-9)


def test_rigid_movements_cost_nothing():
    mesh = small()
    matrix = fem.stiffness(mesh, 1.0, 0.48)
    x, y, _ = mesh.nodes_mm.reshape(-1, 3).T
    turned = np.stack([-y, x, np.zeros_like(x)], axis=-1).ravel()
    np.testing.assert_allclose(matrix @ turned, 0, atol=1e-11)
    np.testing.assert_allclose(matrix @ np.tile([1.0, 2.0, 3.0], len(x)), 0, atol=1e-11)


def test_condensation_equals_the_sparse_solve_of_the_whole_mesh(monkeypatch):
    monkeypatch.setattr(fem, "COLUMNS", 40)
    mesh = distorted()
    compliance = fem.unit_compliance(mesh, 0.48, progress=False)
    assert compliance.shape == (147, 147)
    dofs = fem.free_dofs(mesh).ravel()
    solver = splu(fem.stiffness(mesh, 1.0, 0.48)[dofs][:, dofs].tocsc())
    loads = np.zeros((len(dofs), 147))
    loads[-147:] = np.eye(147)
    np.testing.assert_allclose(compliance, solver.solve(loads)[-147:], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(compliance, compliance.T)
    assert np.linalg.eigvalsh(compliance).min() > 0


def test_agrees_with_the_layer_of_elasticity():
    """A smooth pressure on a flat gel agrees with the closed form of a bonded layer: the elements do not
    lock."""
    nu = 0.48
    layer = Elastomer(modulus_mpa=1.0, poisson_ratio=nu, thickness_mm=3.0, thickness_variation=0)
    x = np.concatenate([np.arange(-8, -4), np.linspace(-4, 4, 17), np.arange(5, 9)])
    mesh = layered(x, x, 0.0, np.array([0.0, 0, 1]), 3.0, np.linspace(0, 1, 5))
    compliance = fem.unit_compliance(mesh, nu, progress=False)
    spread = 1.6
    r = np.hypot(x[1:-1, None], x[1:-1])
    force = np.zeros((23, 23, 3))
    force[..., 2] = -np.exp(-((r / spread) ** 2) / 2) * mesh.areas_mm2()[1:-1, 1:-1]
    moved = (compliance @ force.ravel()).reshape(23, 23, 3)

    def integrand(k):
        return layer_compliance(np.array([k]), layer)[0] * spread**2 * np.exp(-((k * spread) ** 2) / 2) * k

    assert -moved[11, 11, 2] == pytest.approx(quad(integrand, 0, 8 / spread)[0], rel=0.02)


def test_it_is_computed_once_for_each_mesh(tmp_path, monkeypatch):
    first = fem.cached_unit_compliance(small(), 0.48, tmp_path, progress=False)
    np.testing.assert_array_equal(first, fem.unit_compliance(small(), 0.48, progress=False))
    computed = []
    monkeypatch.setattr(fem, "unit_compliance", lambda *_, **__: computed.append(1) or np.eye(3))
    np.testing.assert_array_equal(fem.cached_unit_compliance(small(), 0.48, tmp_path, progress=False), first)
    assert not computed
    fem.cached_unit_compliance(distorted(), 0.48, tmp_path, progress=False)
    fem.cached_unit_compliance(small(), 0.47, tmp_path, progress=False)
    assert len(computed) == 2


def test_a_damaged_result_is_computed_again(tmp_path):
    first = fem.cached_unit_compliance(small(), 0.48, tmp_path, progress=False)
    (path,) = tmp_path.rglob(fem.FILE)
    path.chmod(0o644)
    path.write_bytes(path.read_bytes()[:100])
    np.testing.assert_array_equal(fem.cached_unit_compliance(small(), 0.48, tmp_path, progress=False), first)


def test_an_interrupted_computation_leaves_no_result(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(fem, "unit_compliance", fail)
    with pytest.raises(KeyboardInterrupt):
        fem.cached_unit_compliance(small(), 0.48, tmp_path, progress=False)
    assert not list(tmp_path.rglob(fem.FILE))
