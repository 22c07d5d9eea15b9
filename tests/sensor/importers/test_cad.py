"""The undeformed skin from CAD: an STL file and a height map of the scene's surface give that surface."""

import numpy as np
import pytest
import trimesh

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import rest_depth_at_mm
from fastac.sensor.importers.cad import of_file, of_scene
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.mechanics.indenter import Ball

SENSOR = Sensor(geometry="fingertip", height_px=32, width_px=28, pitch_mm=0.5)
FLAT = Sensor(geometry="flat", height_px=32, width_px=28, pitch_mm=0.5)


def grid(step=0.25, reach=8.5):
    axis = np.arange(-reach, reach + 1e-9, step)
    x, y = np.meshgrid(axis, axis)
    return x, y, rest_depth_at_mm(SENSOR, x, y) + 3.0  # a zero of its own


def save_stl(path, x, y, z):
    """A closed body between the surface and the plane z = −2."""
    n = x.shape[1]
    first = (np.arange(x.shape[0] - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([first, first + 1, first + n], -1), np.stack([first + 1, first + n + 1, first + n], -1)]
    )
    top = np.stack([x, y, z], -1).reshape(-1, 3)
    below = top * (1, 1, 0) - (0, 0, 2)
    mesh = trimesh.Trimesh(np.concatenate([top, below]), np.concatenate([faces, faces[:, ::-1] + len(top)]))
    mesh.export(path)
    return path


def test_a_height_map_is_the_scene_s_surface(tmp_path):
    np.save(tmp_path / "skin.npy", grid()[2])
    found, own = of_file(SENSOR, tmp_path / "skin.npy", 0.25), of_scene(SENSOR)
    np.testing.assert_allclose(found.rest_depth_mm, own.rest_depth_mm, atol=1e-4)
    np.testing.assert_allclose(found.normals(), own.normals(), atol=1e-3)
    assert found.rest_depth_mm.min() == pytest.approx(0, abs=1e-9)


def test_an_stl_file_is_the_scene_s_surface(tmp_path):
    found, own = of_file(SENSOR, save_stl(tmp_path / "skin.stl", *grid())), of_scene(SENSOR)
    np.testing.assert_allclose(found.rest_depth_mm, own.rest_depth_mm, atol=3e-3)  # facets of 0.25 mm
    np.testing.assert_allclose(found.normals(), own.normals(), atol=1e-2)


def test_first_touch(tmp_path):
    assert of_scene(FLAT).first_touch_mm(4.0, 1.0, 2.0) == pytest.approx(0, abs=1e-3)
    own = of_scene(SENSOR)
    x, y = np.meshgrid(np.linspace(-6, 6, 1201), np.linspace(-7, 7, 1401))
    exact = (own.depth_at_mm(x, y) - Ball(5.0).surface(x - 2.3, y + 3.1)[0]).max()
    assert own.first_touch_mm(5.0, 2.3, -3.1) == pytest.approx(exact, abs=1e-3)
    assert own.first_touch_mm(5.0, 2.3, -3.1) > own.depth_at_mm(np.array(2.3), np.array(-3.1))


@pytest.mark.parametrize(
    ("name", "content", "pitch_mm", "message"),
    [
        ("skin.npy", None, 0.25, "no such file"),
        ("skin.npy", b"nonsense", 0.25, "not a readable array"),
        ("skin.npy", np.zeros((4, 4, 4)), 0.25, "expected numbers"),
        ("skin.npy", np.zeros((9, 9)), 0.25, r"x = ±1 mm: the image needs ±6\.75 mm"),
        ("skin.npy", np.zeros((99, 99)), None, "pitch_mm = None: a height map needs"),
        ("skin.npy", np.full((99, 99), np.nan), 0.25, "with no holes"),
        ("skin.npy", np.array([None] * 9), 0.25, "not a readable array"),
        ("skin.stl", None, None, "no such file"),
        ("skin.stl", b"solid nonsense", None, "not a readable STL file"),
        ("skin.stl", b"x" * 200, None, "not a readable STL file"),
        ("skin.stl", "patch", None, "with no holes"),
        ("skin.stl", "whole", 0.25, "an STL file has its own scale"),
        ("skin.step", b"", None, "expected an STL file or a height map"),
    ],
)
def test_refuses_what_is_no_surface_over_the_image(tmp_path, name, content, pitch_mm, message):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, np.ndarray):
        np.save(path, content)
    elif content is not None:
        save_stl(path, *grid(reach=8.5 if content == "whole" else 3.0))
    with pytest.raises(ImportFailure, match=message) as error:
        of_file(SENSOR, path, pitch_mm)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
