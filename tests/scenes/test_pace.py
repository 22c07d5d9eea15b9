"""Paces of pixels, and the slowest that a camera allows."""

import pytest
from pydantic import ValidationError

from fastac.models.random_bundle import scene
from fastac.scenes.pace import PACES, Camera, Pace, pace_of, slowest_pace
from fastac.scenes.schema import Scene


def camera_scene(clock_mhz: float = 100, **sensor) -> Scene:
    content = scene(("force_z",), size=128).model_dump(mode="json")
    content["hardware"] |= {"pixels_per_clock": "camera", "clock_mhz": clock_mhz}
    content["sensor"] |= sensor
    return Scene.model_validate(content)


def test_values_name_the_paces():
    assert [pace.value for pace in PACES] == ["1/16", "1/8", "1/4", "1/2", 1, 2, 4]
    assert all(pace_of(pace.value) == pace for pace in PACES)
    assert [pace.clocks_per_pixel for pace in PACES] == [16, 8, 4, 2, 1, 0.5, 0.25]


def test_a_camera_sends_pixels_between_its_pauses():
    assert Camera(128, 128, 240).clocks_per_pixel(100) == pytest.approx(25.431, abs=1e-3)
    assert Camera(128, 128, 240, 32, 72).clocks_per_pixel(100) == pytest.approx(100e6 / 240 / 200 / 160)


@pytest.mark.parametrize(
    ("frames_per_second", "pace"),
    [(60, "1/16"), (381.4, "1/16"), (381.5, "1/8"), (2000, "1/2"), (6000, 1), (6200, 2), (24000, 4)],
)
def test_the_slowest_pace_never_makes_the_camera_wait(frames_per_second, pace):
    found = camera_scene(frames_per_second=frames_per_second)
    assert found.pace.value == pace
    margin = found.pace.margin(found.camera_clocks_per_pixel)
    assert margin >= 0
    slower = PACES[: PACES.index(found.pace)]
    assert all(each.margin(found.camera_clocks_per_pixel) < 0 for each in slower)


def test_pauses_make_the_camera_faster():
    assert camera_scene(frames_per_second=240, frame_blanking_lines=100).pace == Pace(1, 8)
    assert camera_scene(frames_per_second=240, line_blanking_px=100).pace == Pace(1, 8)


def test_lanes_that_do_not_divide_a_line_are_left_out():
    assert slowest_pace(0.6, 126) == Pace(2, 1)
    with pytest.raises(ValueError, match=r"sends 3\.33 pixels a clock, and there is hardware for 2 at most"):
        slowest_pace(0.3, 126)


def test_without_a_rate_there_is_no_camera_to_follow():
    with pytest.raises(ValidationError, match=r"'camera' needs sensor\.frames_per_second"):
        camera_scene()
    with pytest.raises(ValidationError, match="line_blanking_px: 3 needs frames_per_second"):
        camera_scene(line_blanking_px=3)


def test_a_camera_that_is_too_fast_is_refused():
    with pytest.raises(ValidationError, match=r"'camera' sends 4\.92 pixels a clock"):
        camera_scene(frames_per_second=30000)
