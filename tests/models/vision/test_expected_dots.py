"""The dots that a scene alone promises, against those of a rendered background."""

import numpy as np
import pytest

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.vision.dots import bridge_of, follower_of
from fastac.models.vision.expected_dots import expected_follower
from fastac.sensor.optics.camera import background
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.optics.skin_paint import coverage


@pytest.mark.parametrize("geometry", ["flat", "fingertip"])
def test_the_expected_follower_is_of_the_virtual_fingertip_s_dots(make_scene, geometry):
    """It has as many dots, windows of the same size and the same reach as that of a rendered background."""
    markers = {"spacing_mm": 1.0, "radius_mm": 0.2}
    size = {"height_px": 32, "width_px": 32, "pitch_mm": 0.125}
    sensor = make_scene(sensor={"geometry": geometry, **size, "markers": markers}).sensor
    expected = expected_follower(sensor)
    places = marker_pixels(sensor)
    assert len(places) == 9
    np.testing.assert_allclose(expected.rest / (1 << FRACTION), places, atol=0.5 / (1 << FRACTION))
    shown = background(sensor, np.random.default_rng(1))
    found = follower_of(shown, sensor)
    assert len(found.rest) == len(places)
    away = np.abs(found.rest[:, None] - expected.rest).max(axis=-1)
    assert away.min(axis=1).max() < 0.1 * (1 << FRACTION)
    assert sorted(away.argmin(axis=1)) == list(range(9))
    assert (found.windows.half, found.reach) == (expected.windows.half, expected.reach)
    assert found.windows.shape == expected.windows.shape
    assert found.windows.mass_bound <= expected.windows.mass_bound
    assert found.width <= expected.width
    assert bridge_of(shown, sensor).dark(shown)[coverage(sensor, places) > 0.9].all()
