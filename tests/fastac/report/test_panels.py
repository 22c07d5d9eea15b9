"""Panels of a frame: which there are, their colours and the ends of their colour bars."""

import base64
import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fastac.models.emulator.pipeline import Emulator
from fastac.report import panels as report_panels
from fastac.report.panels import Panel, more_panels, panels


@pytest.fixture(scope="module")
def found(tiny_bundle, tiny_data):
    return Emulator(tiny_bundle.pipeline).run(tiny_data.frames[3:4])


def test_pictures_are_red_green_blue():
    frame = np.zeros((1, 1, 4), np.uint8)
    frame[0, 0] = (1, 2, 3, 99)  # B, G, R, NIR
    np.testing.assert_array_equal(report_panels.rgb(frame)[0, 0], [3, 2, 1])
    np.testing.assert_array_equal(report_panels.rgb(frame[..., :3])[0, 0], [3, 2, 1])


@pytest.mark.parametrize(
    ("labels", "with_depth", "titles"),
    [
        ("geometry", True, ["input (RGB)", "NIR", "normals", "depth", "displacement"]),
        ("geometry", False, ["input (RGB)", "NIR", "normals"]),
        ("force", False, ["input (RGB)", "NIR"]),
    ],
)
def test_panels_of_a_frame(tiny_scene, tiny_data, found, labels, with_depth, titles):
    scene = tiny_scene.model_copy(
        update={"training": tiny_scene.training.model_copy(update={"labels": labels})}
    )
    result = found if with_depth else replace(found, depth_mm=None, displacement_mm=None)
    shown = panels(tiny_data, 3, result, scene)
    assert [panel.title for panel in shown] == titles
    np.testing.assert_array_equal(shown[0].image, tiny_data.frames[3][..., 2::-1])
    assert {panel.pixels.shape for panel in shown} <= {(16, 16, 3), (14, 14, 3)}
    assert {panel.pixels.dtype for panel in shown} == {np.dtype(np.uint8)}


def test_slopes_that_were_bent_for_a_force_are_not_shown_as_normals(make_scene, tiny_data, found):
    of_slopes = {"poisson": {"solver": "adjoint"}, "force": {"clamp": False, "fit": "slopes"}}
    result = replace(found, depth_mm=None, displacement_mm=None)
    for training, titles in (({}, ["normals"]), ({"force_steps": 5}, [])):
        scene = make_scene(outputs=["force_xyz"], training=training, **of_slopes)
        shown = panels(tiny_data, 3, result, scene)
        assert [panel.title for panel in shown] == ["input (RGB)", "NIR", *titles]


def test_errors_and_force_maps_where_they_are_known(tiny_scene, tiny_data, found):
    [error] = more_panels(tiny_data, 3, found, tiny_scene)
    assert (error.title, error.unit) == ("depth error", "mm")
    np.testing.assert_allclose(error.image, found.depth_mm[0] - tiny_data.depth_mm[3])
    valid = np.zeros(tiny_data.depth_mm.shape, bool)
    [unknown] = more_panels(replace(tiny_data, valid=valid), 3, found, tiny_scene)
    assert not unknown.image.any()
    assert more_panels(replace(tiny_data, depth_mm=None), 3, found, tiny_scene) == []
    mapped = replace(found, force_map_n=np.ones((1, 1, 14, 14)))
    assert [panel.title for panel in more_panels(tiny_data, 3, mapped, tiny_scene)] == [
        "depth error",
        "F_z map",
    ]


def test_colours_run_between_the_ends():
    panel = Panel("p", np.array([[0.0, 2.0]]), "mm", "gray")
    assert panel.ends == (0, 2)
    assert panel.pixels[0, :, 0].tolist() == [0, 255]
    assert (panel.shades[0], panel.shades[-1]) == ("#000000", "#ffffff")
    assert Panel("p", np.array([[-1.0, 3.0]]), colours="gray", signed=True).ends == (-3, 3)
    assert Panel("p", np.array([[5, 6]]), colours="gray", low=0, high=255).ends == (0, 255)
    assert Panel("p", np.zeros((2, 2)), colours="gray").pixels.shape == (2, 2, 3)


def test_the_png_holds_the_pixels():
    panel = Panel("p", np.arange(12, dtype=np.uint8).reshape(2, 2, 3))
    with Image.open(io.BytesIO(base64.b64decode(panel.base64_png))) as image:
        np.testing.assert_array_equal(np.asarray(image), panel.image)
