"""Where the dots are on the undeformed skin, and in the image of one that has moved."""

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.marker_grid import marker_centres_mm, marker_pixels

FLAT = {"geometry": "flat", "height_px": 64, "width_px": 48, "pitch_mm": 0.25}
DOTTED = Sensor(**FLAT, markers={"spacing_mm": 2.0, "radius_mm": 0.5})


def test_without_markers_there_are_none():
    bare = Sensor(**FLAT)
    assert marker_centres_mm(bare).shape == (0, 2)
    assert marker_pixels(bare, np.ones((64, 48, 2))).shape == (0, 2)


def test_dots_lie_on_a_grid_about_the_centre_inside_the_rim():
    centres = marker_centres_mm(DOTTED)
    np.testing.assert_allclose(centres.mean(axis=0), 0, atol=1e-12)
    assert np.abs(centres[:, 0]).max() <= 47 / 2 * 0.25 - DOTTED.elastomer.rim_mm
    assert np.abs(centres[:, 1]).max() <= 63 / 2 * 0.25 - DOTTED.elastomer.rim_mm
    assert set(np.diff(np.unique(centres[:, 0]))) == {2.0}


def test_dots_move_with_the_skin():
    shift_px = np.array([2.0, -1.0])
    moved = np.broadcast_to(shift_px * 0.25, (64, 48, 2))
    np.testing.assert_allclose(marker_pixels(DOTTED, moved) - marker_pixels(DOTTED), [shift_px] * 35)
