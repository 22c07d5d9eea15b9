import numpy as np
import pytest

from fastac.sensor.optics.raw_camera import RawCamera
from fastac.studies.benchmarks.image_processing import CAMERAS, PATHS, errors, noise_free


def smooth_light(size=64):
    v, u = np.mgrid[:size, :size] / size
    return np.stack([0.2 + 0.1 * v, 0.3 + 0.1 * u, 0.25 + 0.05 * (u + v), 0.3 - 0.1 * v], axis=-1)


def test_reference_is_the_mean_light_of_a_cell_in_8_bits():
    camera = RawCamera(vignetting=0.0)
    reference = noise_free(smooth_light(), camera)
    assert reference.shape == (16, 16, 4)
    expected = smooth_light()[4:8, 8:12, 2].mean() * (1023 - 64) * 255 / 1023
    assert reference[1, 2, 2] == pytest.approx(expected, rel=1e-5)


def test_smooth_noise_free_light_costs_only_rounding():
    light = [smooth_light()]
    for path in PATHS.values():
        mean, _ = errors(light, CAMERAS["no noise, no crosstalk"], path)
        assert (mean < 0.6).all()


def test_unequal_crosstalk_shows_in_blue_and_red_alone():
    light = [smooth_light()]
    equal, unequal = (errors(light, CAMERAS[name], PATHS["paper"])[0] for name in list(CAMERAS)[-2:])
    assert (unequal[[0, 2]] > equal[[0, 2]] + 2).all()
    np.testing.assert_allclose(unequal[[1, 3]], equal[[1, 3]], atol=0.1)
