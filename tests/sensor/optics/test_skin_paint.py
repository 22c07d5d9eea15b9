"""Grain and marker dots: their positions on the undeformed skin, and that they move with the skin."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.marker_grid import marker_centres_mm
from fastac.sensor.optics.skin_paint import albedo, grain


def sensor(**keys):
    return Sensor(
        **{"geometry": "flat", "height_px": 64, "width_px": 48, "pitch_mm": 0.25, "grain": 0.0, **keys}
    )


DOTTED = sensor(markers={"spacing_mm": 2.0, "radius_mm": 0.5, "contrast": 0.8})


def test_without_markers_there_are_none():
    assert (albedo(sensor()) == 1).all()


def test_a_dot_is_as_dark_and_as_large_as_the_scene_says():
    image = albedo(DOTTED)
    assert image.min() == pytest.approx(0.2)
    dark = (1 - image).sum() / 0.8 * 0.25**2
    assert dark == pytest.approx(len(marker_centres_mm(DOTTED)) * np.pi * 0.25, rel=0.03)


def test_dots_and_grain_move_with_the_skin():
    shift_px = np.array([2.0, -1.0])
    moved = np.broadcast_to(shift_px * 0.25, (64, 48, 2))
    painted = sensor(grain=0.05, markers={"spacing_mm": 2.0, "radius_mm": 0.5})
    at_rest, now = albedo(painted), albedo(painted, moved)
    np.testing.assert_allclose(now[:-1, 2:], at_rest[1:, :-2], atol=1e-12)
    assert (now != at_rest).any()


def test_dots_may_leave_the_image():
    away = np.full((64, 48, 2), 100.0)
    assert (albedo(DOTTED, away) == 1).all()


def test_grain_moves_as_scipy_interpolates_it():
    painted = sensor(grain=0.05)
    moved_mm = np.random.default_rng(1).uniform(-1, 1, (64, 48, 2))
    v, u = np.indices((64, 48))
    from_v, from_u = v - moved_mm[..., 1] / 0.25, u - moved_mm[..., 0] / 0.25
    want = map_coordinates(grain(painted), [from_v, from_u], order=1, mode="nearest")
    np.testing.assert_array_equal(albedo(painted, moved_mm), want)
