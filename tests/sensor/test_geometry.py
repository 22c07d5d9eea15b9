import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import (
    ball_slopes,
    normals_from_slopes,
    pixel_centres_mm,
    rest_depth_mm,
    rest_slopes,
)

CURVED = Sensor(geometry="fingertip", height_px=40, width_px=48, pitch_mm=0.25)


def test_axes_run_with_rows_and_columns():
    x, y = pixel_centres_mm(CURVED)
    assert x.shape == y.shape == (40, 48)
    np.testing.assert_allclose(np.diff(x, axis=1), 0.25)
    np.testing.assert_allclose(np.diff(y, axis=0), 0.25)
    assert x[0, 0] == -47 * 0.125
    assert y[0, 0] == -39 * 0.125


def test_cap_lies_on_the_ellipsoid_and_is_zero_at_the_corners():
    x, y = pixel_centres_mm(CURVED)
    z = rest_depth_mm(CURVED)
    np.testing.assert_allclose(z[[0, 0, -1, -1], [0, -1, 0, -1]], 0, atol=1e-12)
    assert z.min() > -1e-12
    a, b, c = CURVED.ellipsoid.semi_axes_mm
    base = c * np.sqrt(1 - (x[0, 0] / a) ** 2 - (y[0, 0] / b) ** 2)
    np.testing.assert_allclose((x / a) ** 2 + (y / b) ** 2 + ((z + base) / c) ** 2, 1)


def test_slopes_are_the_derivatives_of_the_depth():
    fine = Sensor(geometry="fingertip", height_px=250, width_px=250, pitch_mm=0.04)
    q, p = np.gradient(rest_depth_mm(fine), fine.pitch_mm)
    analytic_p, analytic_q = rest_slopes(fine)
    np.testing.assert_allclose(analytic_p[1:-1, 1:-1], p[1:-1, 1:-1], atol=1e-4)
    np.testing.assert_allclose(analytic_q[1:-1, 1:-1], q[1:-1, 1:-1], atol=1e-4)


def test_flat_is_zero():
    flat = Sensor(geometry="flat", height_px=20, width_px=30)
    for array in (rest_depth_mm(flat), *rest_slopes(flat)):
        np.testing.assert_array_equal(array, np.zeros((20, 30)))


def test_a_pressed_skin_rises_away_from_the_ball():
    p, q = ball_slopes(np.array([0.0, 1.5, 0.0]), np.array([0.0, 0.0, -1.5]), 5.0)
    assert p == pytest.approx([0, 0.75, 0])
    assert q == pytest.approx([0, 0, -0.75])


def test_normals_point_outwards():
    n = normals_from_slopes(np.array([[0.0, 0.75]]), np.array([[0.0, 0.0]]))
    np.testing.assert_allclose(n, [[[0, 0, 1], [-0.6, 0, 0.8]]], atol=1e-12)
