import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, pixel_centres_mm, rest_depth_mm, rest_slopes
from fastac.sensor.mechanics.fem.mesh import GelMesh, layered, sensor_mesh
from fastac.sensor.mechanics.press import FemError

CURVED = Sensor(geometry="fingertip", height_px=33, width_px=33, pitch_mm=0.5)


def test_skin_is_the_sensor_s_and_the_thickness_lies_along_its_normal():
    mesh = sensor_mesh(CURVED, elements=32, layers=3)
    x, y = pixel_centres_mm(CURVED)
    np.testing.assert_allclose(mesh.skin_mm, np.stack([x, y, rest_depth_mm(CURVED)], axis=-1), atol=1e-12)
    through = mesh.skin_mm - mesh.nodes_mm[0]
    thickness = np.linalg.norm(through, axis=-1)
    np.testing.assert_allclose(through / thickness[..., None], normals_from_slopes(*rest_slopes(CURVED)))
    np.testing.assert_allclose(thickness[[0, 16, -1]], np.array([[2.1], [3.0], [3.9]]) * np.ones(33))
    heights = np.linalg.norm(np.diff(mesh.nodes_mm, axis=0), axis=-1)[:, 16, 16]
    assert heights.sum() == pytest.approx(3.0)
    assert (np.diff(heights) < 0).all(), "thinner towards the skin"


def test_elements_fill_the_gel():
    mesh = sensor_mesh(Sensor(geometry="flat", height_px=17, width_px=33, pitch_mm=0.5), elements=8, layers=2)
    assert mesh.nodes_mm.shape == (3, 5, 9, 3)
    assert mesh.shape == (3, 7)
    hexahedra = mesh.mesh
    assert hexahedra.nelements == 4 * 8 * 2
    np.testing.assert_array_equal(hexahedra.p.T, mesh.nodes_mm.reshape(-1, 3))
    assert hexahedra.is_valid()
    determinant = np.linalg.det(hexahedra.mapping().DF(np.full((3, 1), 0.5))[..., 0].transpose(2, 0, 1))
    assert determinant.sum() == pytest.approx(16 * 8 * 3.0), "mean thickness 3 mm"
    assert mesh.areas_mm2().sum() == pytest.approx(16 * 8)


def test_refuses_a_gel_that_folds():
    """Normals that meet within the thickness turn elements inside out."""
    x = np.linspace(-3, 3, 7)
    slope = np.broadcast_to(-x, (7, 7))
    normals = normals_from_slopes(slope, np.zeros((7, 7)))
    z = np.broadcast_to(-(x**2) / 2, (7, 7))
    assert layered(x, x, z, normals, 0.5, [0, 1]).smallest_volume() > 0
    with pytest.raises(FemError, match="an element's volume is -"):
        layered(x, x, z, normals, 3.0, [0, 1])


def test_refuses_too_few_nodes():
    with pytest.raises(FemError, match="1 layers of 2 x 3 nodes"):
        GelMesh(np.zeros((2, 2, 3, 3)))
