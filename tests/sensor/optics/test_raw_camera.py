import numpy as np
import pytest

from fastac.sensor.optics.mosaic import MosaicError
from fastac.sensor.optics.raw_camera import RawCamera

CLEAN = {"vignetting": 0.0, "dead_share": 0.0}


def grey(level, size=64):
    return np.full((size, size, 4), level)


def test_noise_has_the_deviation_of_photons_and_read_noise():
    camera = RawCamera(electrons_per_dn=4.0, read_noise_dn=3.0, crosstalk=(0, 0, 0), **CLEAN)
    raw = camera.expose(grey(0.5, 128), np.random.default_rng(1))
    signal = 0.5 * (1023 - 64)
    assert raw.dtype == np.uint16
    assert raw.mean() == pytest.approx(64 + signal, abs=0.5)
    assert raw.std() == pytest.approx(np.sqrt(signal / 4 + 9 + 1 / 12), rel=0.03)


def test_dark_frame_is_the_black_level_with_read_noise():
    raw = RawCamera(read_noise_dn=2.0, **CLEAN).expose(grey(0.0), np.random.default_rng(1))
    assert raw.mean() == pytest.approx(64, abs=0.2)
    assert raw.std() == pytest.approx(np.sqrt(4 + 1 / 12), rel=0.05)


def test_saturates_at_ten_bits():
    raw = RawCamera(**CLEAN).expose(grey(3.0), np.random.default_rng(1))
    np.testing.assert_array_equal(raw, 1023)


def test_vignetting_darkens_the_corners_by_its_share():
    camera = RawCamera(vignetting=0.3, dead_share=0)
    shading = camera.shading(65, 33)
    assert shading[32, 16] == 1
    np.testing.assert_allclose(shading[[0, 0, -1, -1], [0, -1, 0, -1]], 0.7)
    light = grey(0.2)
    bare = RawCamera(**CLEAN).expected_dn(light)
    np.testing.assert_allclose(camera.expected_dn(light), bare * camera.shading(64, 64))


def test_dead_pixels_are_the_camera_s_own():
    camera = RawCamera(dead_share=0.01, seed=3)
    dead, hot = camera.dead_pixels(64, 64)
    assert 5 <= dead.sum() <= 40
    assert 5 <= hot.sum() <= 40
    for seed in (0, 1):
        raw = camera.expose(grey(0.3), np.random.default_rng(seed))
        assert (raw[dead] == 0).all()
        assert (raw[hot] == 1023).all()
        assert ((raw > 64) & (raw < 1023))[~dead & ~hot].all()
    assert (RawCamera(dead_share=0.01, seed=4).dead_pixels(64, 64)[0] != dead).any()


def test_the_generator_decides_the_noise():
    camera, light = RawCamera(), grey(0.3)
    first = camera.expose(light, np.random.default_rng(1))
    np.testing.assert_array_equal(first, camera.expose(light, np.random.default_rng(1)))
    assert (first != camera.expose(light, np.random.default_rng(2))).any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"vignetting": 1.0}, "vignetting = 1"),
        ({"black_level_dn": 1023}, "black_level_dn = 1023"),
        ({"crosstalk": (0.1, 0.2)}, "three numbers"),
        ({"dead_share": -0.1}, "dead_share"),
    ],
)
def test_refuses_impossible_settings(settings, message):
    with pytest.raises(MosaicError, match=message):
        RawCamera(**settings)


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_refuses_light_that_cannot_be(value):
    light = grey(0.5)
    light[3, 4, 2] = value
    with pytest.raises(MosaicError, match="finite numbers of at least 0"):
        RawCamera().expose(light, np.random.default_rng(0))
