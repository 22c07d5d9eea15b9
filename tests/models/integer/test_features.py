import numpy as np
import pytest

from fastac.models.integer.features import WIDTH, coordinate_codes, integer_features, limits, scales


@pytest.mark.parametrize("size", [16, 63, 128, 256])
def test_coordinate_codes_span_the_image_evenly(size):
    codes = coordinate_codes(size)
    assert codes.shape == (size,)
    assert (codes[0], codes[-1]) == (-127, 127)
    np.testing.assert_array_equal(codes, -codes[::-1])
    exact = [254 * k / (size - 1) - 127 for k in range(size)]
    assert np.abs(codes - exact).max() <= 0.5 + 1e-9


def test_features_pixel_by_pixel():
    """Not square, so that u and v cannot be swapped; differences over the whole range, so that none wraps."""
    rng = np.random.default_rng(1)
    frames = rng.integers(0, 256, (2, 5, 7, 4), dtype=np.uint8)
    background = rng.integers(0, 256, (5, 7, 4), dtype=np.uint8)
    frames[0, 0, 0], background[0, 0] = 0, 255
    frames[0, 0, 1], background[0, 1] = 255, 0
    found = integer_features(frames, background)
    assert found.shape == (2, 5, 7, 6)
    for k, v, u in np.ndindex(2, 5, 7):
        change = [int(a) - int(b) for a, b in zip(frames[k, v, u], background[v, u], strict=True)]
        x, y = round(254 * u / 6 - 127), round(254 * v / 4 - 127)
        assert found[k, v, u].tolist() == [*change, x, y]
    assert found[0, 0, 0, :4].tolist() == [-255] * 4
    assert found[0, 0, 1, :4].tolist() == [255] * 4


def test_the_background_has_no_difference():
    background = np.random.default_rng(2).integers(0, 256, (4, 4, 3), dtype=np.uint8)
    found = integer_features(background, background)
    assert not found[..., :3].any()
    assert found[..., 3:].any()


@pytest.mark.parametrize("channels", [3, 4])
def test_limits_and_scales_are_the_features_own(channels):
    dark, light = (np.full((16, 16, channels), value, np.uint8) for value in (0, 255))
    extremes = np.stack([integer_features(dark, light), integer_features(light, dark)])
    np.testing.assert_array_equal(np.abs(extremes).max(axis=(0, 1, 2)), limits(channels))
    assert limits(channels).max() < 2 ** (WIDTH - 1)
    np.testing.assert_allclose(scales(channels), [1 / 64] * channels + [1 / 127] * 2)
