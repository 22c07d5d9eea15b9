"""The RAW10 window: 4 × 4 raw pixels have their pixel's light, and dots are drawn at the raw resolution."""

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import normals_from_slopes, rest_depth_mm, rest_slopes
from fastac.sensor.optics.camera import noise_free_image
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.sensor.optics.raw_window import background_raw10, raw_camera, render_raw10, window_light


def sensor(**keys):
    return Sensor(
        **{
            "geometry": "fingertip",
            "height_px": 32,
            "width_px": 24,
            "pitch_mm": 0.25,
            "frames": "raw10",
            **keys,
        }
    )


def rest(of):
    return normals_from_slopes(*rest_slopes(of)), rest_depth_mm(of)


def test_a_cell_has_the_light_of_its_pixel():
    plain = sensor(grain=0.0)
    light = window_light(*rest(plain), plain)
    assert light.shape == (128, 96, 4)
    cells = light.reshape(32, 4, 24, 4, 4).mean(axis=(1, 3))
    wanted = noise_free_image(*rest(plain), plain) / 255 * 0.75
    np.testing.assert_allclose(cells[1:-1, 1:-1], wanted[1:-1, 1:-1], rtol=2e-3)


def test_three_colours_are_a_choice_of_the_processing_not_of_the_camera():
    colours = window_light(*rest(sensor(channels="bgr")), sensor(channels="bgr"))
    np.testing.assert_array_equal(colours, window_light(*rest(sensor()), sensor()))


def test_dots_are_dark_where_they_have_moved_to():
    dotted = sensor(markers={"spacing_mm": 2.0, "radius_mm": 0.5}, grain=0.0)
    moved = np.full((32, 24, 2), (0.25, 0.5))
    light = window_light(*rest(dotted), dotted, moved)[..., 1]
    plain = window_light(*rest(sensor(grain=0.0)), sensor(grain=0.0))[..., 1]
    lacking = 1 - light / plain
    u, v = (marker_pixels(dotted, moved) * 4 + 1.5).round().astype(int).T
    np.testing.assert_allclose(lacking[v, u], 0.9, atol=1e-5)
    assert 0 < (lacking > 0.01).mean() < 0.3
    seen = np.array([np.average(np.indices(lacking.shape)[k], weights=lacking) for k in (1, 0)])
    np.testing.assert_allclose((seen - 1.5) / 4, marker_pixels(dotted, moved).mean(axis=0), atol=0.01)


def test_the_seed_decides_the_noise_and_the_background_is_quieter():
    own = sensor()
    one, same = (render_raw10(*rest(own), own, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(one, same)
    assert one.dtype == np.uint16
    background = background_raw10(own, np.random.default_rng(2)).astype(float)
    expected = raw_camera(own).expected_dn(window_light(*rest(own), own)) + 64
    live = ~np.logical_or(*raw_camera(own).dead_pixels(128, 96))
    noise, quiet = ((image - expected)[live].std() for image in (one.astype(float), background))
    assert 3 < noise / quiet < 5  # sixteen exposures
