import numpy as np
import pytest

from fastac.models.integer.smoothing import WINDOWS_PX, shift, smoothed, weights


def by_definition(difference: np.ndarray, window_px: int) -> np.ndarray:
    """Weighted sums in int64, one place of the window after another, then the mean, rounded half up."""
    half, taps = window_px // 2, weights(window_px)
    height, width = difference.shape[-3:-1]
    around = [(0, 0)] * (difference.ndim - 3) + [(half, half), (half, half), (0, 0)]
    padded, total = np.pad(difference, around, mode="edge"), np.zeros_like(difference)
    for i, of_row in enumerate(taps):
        for j, of_column in enumerate(taps):
            total += of_row * of_column * padded[..., i : i + height, j : j + width, :]
    return (2 * total + taps.sum() ** 2) // (2 * taps.sum() ** 2)


@pytest.mark.parametrize("window_px", WINDOWS_PX)
@pytest.mark.parametrize("shape", [(9, 12, 1), (2, 17, 9, 3), (2, 2, 6, 16, 4)])
def test_equals_its_definition(window_px, shape):
    rng = np.random.default_rng(1)
    for limit in (255, 1):
        difference = rng.integers(-limit, limit + 1, shape)
        found = smoothed(difference, window_px)
        assert found.dtype == np.int16
        np.testing.assert_array_equal(found, by_definition(difference, window_px))


@pytest.mark.parametrize("window_px", WINDOWS_PX)
def test_extremes(window_px):
    assert weights(window_px).sum() ** 2 == 1 << shift(window_px)
    for value in (0, 255, -255):
        assert (smoothed(np.full((10, 11, 3), value), window_px) == value).all()
    bright = np.zeros((21, 21, 1), int)
    bright[10, 10] = 255
    spread = smoothed(bright, window_px)[..., 0]
    assert spread[10, 10] == round(255 / window_px**2)
    reached = np.argwhere(spread)
    assert np.abs(reached - 10).max() <= window_px // 2
    # Between dark and bright halves the means beside the edge are off by the pixel that they are centred on.
    edge = np.where(np.arange(20)[:, None] < 10, -window_px, window_px)[None].repeat(20, axis=0)
    assert smoothed(edge, window_px)[10, 9:11, 0].tolist() == [-1, 1]
    half = np.where(np.arange(20)[:, None] < 10, 0, window_px)[None].repeat(20, axis=0)
    middle = window_px // 2  # of half a window, and a half pixel more or less, rounded up
    assert smoothed(half, window_px)[10, 9:11, 0].tolist() == [middle, middle + 1]
    slope = np.arange(-20, 20)[None, :, None].repeat(20, axis=0)
    inner = slice(window_px, -window_px)
    np.testing.assert_array_equal(smoothed(slope, window_px)[:, inner], slope[:, inner])


def test_noise_falls_with_the_window():
    noise = np.rint(np.random.default_rng(1).normal(scale=32, size=(200, 200, 1)))
    for window_px in WINDOWS_PX:
        share = np.sqrt((weights(window_px) ** 2).sum()) / weights(window_px).sum()
        assert smoothed(noise, window_px).std() == pytest.approx(32 * share**2, rel=0.05)
        assert share**2 == pytest.approx(1 / window_px, rel=0.5)


def test_other_windows_are_refused():
    with pytest.raises(ValueError, match=r"^window_px 3: expected one of \(2, 4, 8\)$"):
        smoothed(np.zeros((8, 8, 1), int), 3)
