"""From a scene's background to its follower, and on photographs of a dotted gel beside the detector."""

import dots
import numpy as np
import pytest

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.vision.dots import follower_of
from fastac.models.vision.markers import MarkerError

SIDE = 96


@pytest.fixture
def sensor(make_scene):
    markers = {"spacing_mm": dots.SPACING_PX * 0.1, "radius_mm": dots.RADIUS_PX * 0.1}
    size = {"height_px": SIDE, "width_px": SIDE, "pitch_mm": 0.1}
    return make_scene(sensor={"geometry": "flat", **size, "markers": markers}).sensor


def test_finds_the_dots_of_an_unevenly_lit_background(sensor):
    light = np.linspace(0.5, 1.6, SIDE)[None, :, None] * np.linspace(1, 0.7, SIDE)[:, None, None]
    background = np.rint(dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE)) * light).astype(np.uint8)
    follower = follower_of(background, sensor)
    rest = follower.rest / (1 << FRACTION)
    true, push = dots.places(SIDE, SIDE), np.array((2.5, -1.25))
    away = np.linalg.norm(rest[:, None] - true, axis=-1).min(axis=1)
    assert len(rest) == len(true)
    assert away.max() < 0.1
    assert follower.windows.half == 2
    assert follower.reach == 3
    moved = np.rint(dots.frame(SIDE, SIDE, true + push) * light).astype(np.uint8)
    shift, seen = follower(follower.windows(moved))
    assert seen.all()
    # The lightest pixels of a dot's edge count as skin.
    np.testing.assert_allclose(shift / (1 << FRACTION), np.broadcast_to(push, shift.shape), atol=0.15)


def test_refused(sensor, tiny_scene):
    frame = dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE))
    with pytest.raises(MarkerError, match=r"sensor\.markers: missing"):
        follower_of(frame, tiny_scene.sensor)
    with pytest.raises(MarkerError, match="background: no dot found"):
        follower_of(np.full_like(frame, 200), sensor)
    with pytest.raises(MarkerError, match="94 × 96 px: expected multiples of 4"):
        follower_of(frame[:94], sensor)
