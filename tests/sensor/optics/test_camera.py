import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, rest_depth_mm, rest_slopes
from fastac.sensor.optics.camera import background, noise_free_image, render


def sensor(**keys):
    return Sensor(**{"geometry": "fingertip", "height_px": 32, "width_px": 32, "pitch_mm": 0.5, **keys})


def at_rest(sensor):
    return normals_from_slopes(*rest_slopes(sensor)), rest_depth_mm(sensor)


@pytest.mark.parametrize("geometry", ["fingertip", "flat"])
def test_background_uses_the_range_without_saturating(geometry):
    image = background(sensor(geometry=geometry), np.random.default_rng(0))
    assert image.dtype == np.uint8
    assert image.shape == (32, 32, 4)
    for channel in np.moveaxis(image, -1, 0):
        assert 140 <= channel.max() <= 180
        assert channel.min() > 5


def test_channels_are_those_of_the_scene_in_order():
    four, three = sensor(channels="bgr+nir"), sensor(channels="bgr")
    normals, depth = at_rest(four)
    np.testing.assert_array_equal(
        noise_free_image(normals, depth, four)[..., :3], noise_free_image(normals, depth, three)
    )


def test_noise_has_the_scene_s_deviation_and_the_seed_decides_it():
    noisy = sensor(noise_dn=3.0)
    normals, depth = at_rest(noisy)
    frame = render(normals, depth, noisy, np.random.default_rng(5))
    np.testing.assert_array_equal(frame, render(normals, depth, noisy, np.random.default_rng(5)))
    assert (frame != render(normals, depth, noisy, np.random.default_rng(6))).any()
    clean = noise_free_image(normals, depth, noisy)
    error = frame - clean
    # Read noise, photon noise of that many electrons, rounding to whole numbers.
    expected = np.sqrt(9 + clean / noisy.electrons_per_dn + 1 / 12)
    assert (error / expected).std() == pytest.approx(1.0, rel=0.05)
    assert abs(error.mean()) < 0.2


def test_grain_is_a_fixed_pattern_common_to_all_channels():
    painted, plain = sensor(grain=0.05), sensor(grain=0.0)
    normals, depth = at_rest(plain)
    albedo = noise_free_image(normals, depth, painted) / noise_free_image(normals, depth, plain)
    np.testing.assert_allclose(albedo, np.broadcast_to(albedo[..., :1], albedo.shape), rtol=1e-12)
    assert albedo.std() == pytest.approx(0.05, rel=0.1)
    np.testing.assert_array_equal(
        noise_free_image(normals, depth, painted), noise_free_image(normals, depth, sensor(grain=0.05))
    )


def test_averaging_leaves_less_noise_in_the_background():
    noisy = sensor(noise_dn=4.0)
    clean = noise_free_image(*at_rest(noisy), noisy)
    error = background(noisy, np.random.default_rng(1)) - clean
    photon = clean.mean() / noisy.electrons_per_dn
    assert error.std() == pytest.approx(np.sqrt((16 + photon) / 16 + 1 / 12), rel=0.1)


def test_clips_to_eight_bits():
    bright = sensor(geometry="flat", light={"brightest_dn": 250}, noise_dn=20.0)
    frame = render(*at_rest(bright), bright, np.random.default_rng(0))
    assert frame.max() == 255
    dark = sensor(geometry="flat", light={"brightest_dn": 10}, noise_dn=20.0)
    assert render(*at_rest(dark), dark, np.random.default_rng(0)).min() == 0


def test_a_frame_is_the_rounded_sum_of_light_and_noise():
    noisy = sensor(noise_dn=60.0)
    normals, depth = at_rest(noisy)
    image = noise_free_image(normals, depth, noisy)
    deviation = np.sqrt(60.0**2 + image / noisy.electrons_per_dn)
    drawn = np.random.default_rng(5).standard_normal(image.shape)
    want = np.clip(np.rint(image + deviation * drawn), 0, 255)
    assert (want == 0).any(), "dark and bright ends are cut off"
    assert (want == 255).any()
    np.testing.assert_array_equal(render(normals, depth, noisy, np.random.default_rng(5)), want)
