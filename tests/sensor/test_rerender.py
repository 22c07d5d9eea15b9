"""Re-rendered frames: equal but for noise with the same sensor, and the noise-free image without noise."""

import numpy as np
import pytest

from fastac.sensor.optics.camera import BACKGROUND_EXPOSURES, noise_free_image
from fastac.sensor.optics.mosaic import CELL
from fastac.sensor.rerender import rerender


def test_the_same_sensor_gives_frames_alike_but_for_the_noise(tiny_data, tiny_scene):
    sensor = tiny_scene.sensor
    background, draw = rerender(tiny_data, sensor, 7)
    assert background.shape == tiny_data.background.shape
    frame, recorded = draw(3), tiny_data.frames[3]
    assert frame.dtype == np.uint8
    deviation = np.sqrt(2 * (sensor.noise_dn**2 + recorded.mean() / sensor.electrons_per_dn))
    difference = frame.astype(int) - recorded
    assert 0.8 * deviation < difference.std() < 1.2 * deviation
    difference = background.astype(int) - tiny_data.background
    assert 0.8 < difference.std() / (deviation / np.sqrt(BACKGROUND_EXPOSURES)) < 1.2


def test_without_noise_it_is_the_light_rounded(tiny_data, tiny_scene):
    still = tiny_scene.sensor.model_copy(update={"noise_dn": 0.0, "electrons_per_dn": 1e12})
    _, draw = rerender(tiny_data, still, 7)
    light = noise_free_image(tiny_data.normals[5].astype(float), tiny_data.depth_mm[5].astype(float), still)
    np.testing.assert_array_equal(draw(5), np.rint(light).clip(0, 255))


@pytest.mark.parametrize("frames", ["channels", "raw10"])
def test_a_sample_s_noise_is_its_own(tiny_data, tiny_scene, frames):
    sensor = tiny_scene.sensor.model_copy(update={"frames": frames})
    background, draw = rerender(tiny_data, sensor, 7)
    _, again = rerender(tiny_data, sensor, 7)
    _, other = rerender(tiny_data, sensor, 8)
    first = draw(0)
    assert first.shape == ((16, 16, 4) if frames == "channels" else (16 * CELL, 16 * CELL))
    assert background.shape == first.shape
    draw(1)
    np.testing.assert_array_equal(again(0), first)
    assert (other(0) != first).any()
