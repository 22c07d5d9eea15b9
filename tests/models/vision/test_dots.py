"""From a scene's background to its follower, and on photographs of a dotted gel beside the detector."""

from pathlib import Path

import cv2
import dots
import numpy as np
import pytest

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.vision.dots import (
    DARK_SHARE,
    bridge_of,
    detected_as,
    follower_of,
    slope_bridge,
    windows_of,
)
from fastac.models.vision.markers import Detector, MarkerError, associate
from fastac.scenes.sensor_schema import Sensor

SIDE = 96
PHOTOGRAPHS = Path(__file__).parents[4] / "shared/data/fots/markers"


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
    error = np.abs(shift / (1 << FRACTION) - push)
    assert error.max() < 0.2
    assert error.mean() < 0.06


def test_thresholds_are_a_share_of_the_skin_s_own_brightness(sensor):
    light = np.linspace(0.5, 1.6, SIDE)[None, :, None]
    skin = np.rint(dots.SKIN * light * np.ones((SIDE, 1, 4)))
    shown = np.rint(dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE)) * light).astype(np.uint8)
    windows = windows_of(shown, sensor)
    assert (windows.channels, windows.half, windows.image) == (4, 2, (SIDE, SIDE))
    blocks = skin.sum(axis=-1).reshape(SIDE // 4, 4, SIDE // 4, 4).mean(axis=(1, 3))
    inner = (slice(2, -2), slice(2, -2))  # the skin is smoothed, and near the edges there is less of it
    np.testing.assert_allclose(windows.threshold[inner], DARK_SHARE * blocks[inner], rtol=0.04)


def test_the_bridge_reaches_over_a_dot(sensor):
    places = dots.places(SIDE, SIDE)
    shown = dots.frame(SIDE, SIDE, places)
    bridge = bridge_of(shown, sensor)
    assert bridge.reach == 3
    np.testing.assert_array_equal(bridge.windows.threshold, windows_of(shown, sensor).threshold)
    dark = bridge.dark(shown)
    v, u = np.indices(dark.shape)
    away = np.hypot(u - places[:, 0, None, None], v - places[:, 1, None, None]).min(axis=0)
    assert dark[away < dots.RADIUS_PX - 0.5].all()
    assert not dark[away > dots.RADIUS_PX + 0.5].any()
    # Nothing of a dot is left, where one more or less wide would keep its own middle.
    assert not np.take_along_axis(dark, bridge.columns(dark), axis=-1).any()
    assert not bridge(shown < 100, dark).any()


def test_no_bridge_where_the_scene_wants_none(tiny_data, tiny_scene):
    assert slope_bridge(tiny_data.background, tiny_scene) is None


def test_detected_dots_are_in_the_follower_s_order(sensor):
    shown = dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE))
    follower = follower_of(shown, sensor)
    found = detected_as(follower, shown, sensor)
    assert len(found.rest_px) == len(follower.rest)
    assert np.linalg.norm(found.rest_px - follower.rest / (1 << FRACTION), axis=-1).max() < 0.2
    assert (np.diff(found.rest_px[:, 1]) < -0.5).any(), "the detector's own order is by its blobs' first rows"
    missing = np.delete(dots.places(SIDE, SIDE), 12, axis=0)
    u, v = np.rint(dots.places(SIDE, SIDE)[12]).astype(int)
    with pytest.raises(MarkerError, match=rf"^dot at {u}, {v} px: not detected in the background$"):
        detected_as(follower, dots.frame(SIDE, SIDE, missing), sensor)


def test_refused(sensor, tiny_scene):
    frame = dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE))
    with pytest.raises(MarkerError, match=r"sensor\.markers: missing, so there are no dots"):
        bridge_of(frame, tiny_scene.sensor)
    with pytest.raises(MarkerError, match="94 × 96 px: expected multiples of 4"):
        bridge_of(frame[:94], sensor)
    with pytest.raises(MarkerError, match="background: 1 dot found: expected 2 or more"):
        follower_of(dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE)[12:13]), sensor)
    with pytest.raises(MarkerError, match=r"sensor\.markers: missing"):
        follower_of(frame, tiny_scene.sensor)
    with pytest.raises(MarkerError, match="background: no dot found"):
        follower_of(np.full_like(frame, 200), sensor)
    with pytest.raises(MarkerError, match="94 × 96 px: expected multiples of 4"):
        follower_of(frame[:94], sensor)


@pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason=f"the dotted gel's photographs are not in {PHOTOGRAPHS}")
def test_photographs_of_a_gel_beside_the_detector():
    """Dots of 11 px, 27 px apart, three channels, on a grid that is neither straight nor level."""
    first, second = (cv2.imread(str(PHOTOGRAPHS / f"{k}.png")) for k in (0, 1))
    markers = {"spacing_mm": 2.7, "radius_mm": 0.55}
    size = {"height_px": first.shape[0], "width_px": 256, "pitch_mm": 0.1}
    sensor = Sensor(geometry="flat", channels="bgr", source="recorded", markers=markers, **size)
    follower = follower_of(first, sensor)
    shift, seen = follower(follower.windows(second))
    places = (follower.rest + shift) / (1 << FRACTION)
    assert len(places) == 90
    assert seen.all()
    assert np.abs(shift).max() > 11 << FRACTION, "the gel was moved by 11 px and more"
    known = Detector(11.0).detect(second)
    matched = associate(places, known, 10)
    away = np.linalg.norm(places - known[matched], axis=-1)[matched >= 0]
    assert len(away) > 80, "the detector leaves out dots at the image's edge"
    assert away.max() < 0.3
