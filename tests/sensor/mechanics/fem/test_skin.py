"""The skin at the pixels follows the nodes' displacement and, in contact, the shape of the ball."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.ndimage import binary_fill_holes

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import ball_slopes, pixel_centres_mm, rest_depth_at_mm, rest_depth_mm
from fastac.sensor.mechanics.fem.gel import Gel
from fastac.sensor.mechanics.fem.skin import _filled, _onto, _spline, skin_of
from fastac.sensor.mechanics.indenter import Ball

SENSOR = Sensor(geometry="fingertip", height_px=80, width_px=80, pitch_mm=0.2)
BALL, X, Y = Ball(5.0), 1.0, -0.6
DRAGS = [(), ((0.4, 0.0),)]


@pytest.fixture(scope="module")
def gel(tmp_path_factory):
    return Gel.of_sensor(SENSOR, tmp_path_factory.mktemp("cache"), elements=20, layers=3, progress=False)


@pytest.fixture(scope="module", params=DRAGS, ids=["vertical", "dragged"])
def pressed(gel, request):
    contact = gel.presses(BALL, X, Y, load_n=1.0, friction=1.0, tangential_loads_n=request.param)[-1]
    return contact, skin_of(contact, SENSOR, BALL, X, Y)


def test_rest_depth_anywhere_is_that_of_the_pixels():
    x, y = pixel_centres_mm(SENSOR)
    np.testing.assert_allclose(rest_depth_at_mm(SENSOR, x, y), rest_depth_mm(SENSOR), atol=1e-12)


def test_in_contact_skin_and_ball_are_one(pressed):
    contact, skin = pressed
    x, y = pixel_centres_mm(SENSOR)
    x, y = x - X - contact.indenter_displacement_mm[0], y - Y - contact.indenter_displacement_mm[1]
    inside = skin.in_contact
    assert inside.sum() > 60
    slopes = -skin.normals[..., :2] / skin.normals[..., 2:]
    np.testing.assert_allclose(
        slopes[inside], np.stack(ball_slopes(x[inside], y[inside], 5.0), -1), atol=1e-9
    )
    ball = BALL.surface(x, y)[0] + contact.first_touch_mm + contact.indenter_displacement_mm[2]
    np.testing.assert_allclose(skin.depth_mm[inside], ball[inside], atol=1e-12)
    assert (skin.depth_mm <= ball).all(), "nothing goes through the ball"
    # The pixels' contact and the nodes' have about the same middle.
    nodes = contact.mesh.skin_mm[contact.in_contact] + contact.displacement_mm[contact.in_contact]
    middle = np.array([x[inside].mean() + X, y[inside].mean() + Y]) + contact.indenter_displacement_mm[:2]
    np.testing.assert_allclose(middle, nodes[:, :2].mean(axis=0), atol=0.3)


def test_depth_is_that_of_the_nodes_spline(pressed):
    contact, skin = pressed
    x, y = pixel_centres_mm(SENSOR)
    depth = contact.depth_at(x, y, lambda x, y: rest_depth_at_mm(SENSOR, x, y))
    error = np.abs(depth - skin.depth_mm)
    assert error[~skin.in_contact].max() < 0.15  # a bend over an element of 0.8 mm
    assert np.quantile(error[~skin.in_contact], 0.98) < 1e-3
    assert error[skin.in_contact].max() < 0.12  # the spline between nodes 0.8 mm apart
    np.testing.assert_allclose(skin.tangential_mm, contact.displacement_at(x, y)[..., :2], atol=1e-9)


def test_normals_are_the_slopes_of_the_depth(pressed):
    _, skin = pressed
    q, p = np.gradient(skin.depth_mm, SENSOR.pitch_mm)
    slopes = -skin.normals[..., :2] / skin.normals[..., 2:]
    error = np.abs(slopes - np.stack([p, q], -1))[1:-1, 1:-1]
    assert error.mean() < 4e-3
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=-1), 1)


def test_a_fold_of_the_skin_leaves_every_depth_finite_and_below_the_ball(gel):
    contact = gel.presses(BALL, -4.0, 3.0, load_n=1.5, friction=1.5, tangential_loads_n=[(0.0, -0.9)])[-1]
    skin = skin_of(contact, SENSOR, BALL, -4.0, 3.0)
    displaced = skin.depth_mm - rest_depth_mm(SENSOR)
    assert np.isfinite(skin.normals).all()
    assert displaced.min() > -2
    assert displaced.max() < 1


def test_holes_are_those_that_no_way_along_rows_and_columns_reaches():
    mask = np.random.default_rng(1).random((40, 30)) < 0.6
    np.testing.assert_array_equal(_filled(mask), binary_fill_holes(mask))
    assert (_filled(mask) != mask).any()
    assert _filled(np.ones((3, 4), bool)).all()
    assert not _filled(np.zeros((3, 4), bool)).any()


def test_a_spline_s_coefficients_give_the_nodes_spline_up_to_the_border():
    nodes, pixels = np.linspace(-3, 3, 13), np.linspace(-3, 3, 49)
    values = np.random.default_rng(1).normal(size=(3, 13, 13))
    on_pixels, on_coefficients = _onto(tuple(nodes), tuple(pixels))
    coefficients = on_coefficients @ values @ on_coefficients.T
    np.testing.assert_allclose(on_pixels, make_interp_spline(nodes, np.eye(13))(pixels))
    fine = on_pixels @ values @ on_pixels.T
    for v, u in ((0, 0), (48, 48), (20, 1), (48, 13)):
        np.testing.assert_allclose(_spline(coefficients, v, u), fine[:, v, u], atol=1e-3)
    np.testing.assert_allclose(_spline(coefficients, 24.0, 24.5), _between(nodes, pixels, values), atol=0.01)
    np.testing.assert_array_equal(_spline(coefficients, -5.0, 60.0), _spline(coefficients, 0.0, 48.0))


def _between(nodes, pixels, values):
    spline = make_interp_spline(nodes, np.eye(13))
    return spline(pixels[24]) @ values @ spline((pixels[24] + pixels[25]) / 2)
