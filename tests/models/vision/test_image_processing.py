import numpy as np
import pytest

from fastac.models.vision.image_processing import (
    ImageProcessing,
    ImageProcessingError,
    cell_means,
    correct_dead_pixels,
    interpolate_nir,
    to_bggr,
)
from fastac.sensor.optics.mosaic import CELL, LAYOUT, MosaicError, mosaic

COLOURS = np.array([300.0, 400.0, 500.0, 200.0])


def raw_of(colours, *, size=32, alpha=0.8, black=64):
    """A noise-free RAW image of uniform light."""
    light = np.broadcast_to(colours, (size, size, 4))
    return np.rint(mosaic(light, (alpha,) * 3) + black).astype(np.uint16)


@pytest.mark.parametrize("path", ["demosaic", "bin_cells"])
def test_uniform_light_keeps_its_colours(path):
    frame = getattr(ImageProcessing(), path)(raw_of(COLOURS))
    assert frame.shape == (8, 8, 4)
    assert frame.dtype == np.uint8
    np.testing.assert_array_equal(frame, np.broadcast_to(np.rint(COLOURS * 255 / 1023), frame.shape))


def test_linear_light_is_reconstructed_inside():
    """Every interpolation of the demosaicing path is exact on an intensity plane, away from the edges."""
    v, u = np.mgrid[:32, :32]
    light = np.stack([100 + 4 * v, 200 + 3 * u, 300 + 2 * v + 2 * u, 50 + v + 3 * u], axis=-1).astype(float)
    raw = np.rint(mosaic(light, (0.5,) * 3) + 64).astype(np.uint16)
    frame = ImageProcessing(alpha=0.5, downsample=1).demosaic(raw)
    inside = slice(6, -6), slice(6, -6)
    assert np.abs(frame[inside] - light[inside] * 255 / 1023).max() < 0.5 + 2 * 255 / 1023


def test_nir_is_sampled_at_odd_rows_and_columns():
    v, u = np.mgrid[:8, :8].astype(np.float32)
    level = np.where((v % 2 == 1) & (u % 2 == 1), 10 * v + u, 999).astype(np.float32)
    dense = interpolate_nir(level)
    expected = 10 * np.maximum(v, 1) + np.maximum(u, 1)
    np.testing.assert_allclose(dense, expected)


def test_infrared_subtraction_is_the_paper_s_equation():
    processing = ImageProcessing(alpha=0.5, beta=2.0)
    visible = np.array([100, 100, 100, 1300, 900], np.float32)
    nir = np.array([40, 300, 800, -50, -500], np.float32)
    expected = [80, 0, 0, 1023, 1023]
    np.testing.assert_allclose(processing.subtract_nir(visible, nir), expected)
    limited = processing.subtract_nir(np.float32(600), np.float32(1000))
    assert limited == pytest.approx(600 - 0.5 * 1023 / 2)


def test_rearrangement_keeps_green_and_the_blue_of_bggr():
    rng = np.random.default_rng(0)
    image = rng.random((16, 16)).astype(np.float32)
    bayer = to_bggr(image)
    for (v, u), channel in np.ndenumerate(LAYOUT):
        kept = np.array_equal(bayer[v::CELL, u::CELL], image[v::CELL, u::CELL])
        assert kept == (channel in (0, 1)), (v, u)
    assert bayer[5, 5] == pytest.approx((image[4, 6] + image[6, 4]) / 2)
    assert bayer[5, 7] == pytest.approx((image[4, 6] + image[6, 8]) / 2)
    assert bayer[4, 6] == pytest.approx((image[2, 6] + image[6, 6] + image[4, 4] + image[4, 8]) / 4)


def test_rearrangement_never_mixes_filters_at_the_edges():
    level = mosaic(np.broadcast_to([1.0, 2.0, 3.0, 9.0], (16, 16, 4)), (0.0,) * 3)
    bayer = np.tile([[1.0, 2.0], [2.0, 3.0]], (8, 8))
    np.testing.assert_allclose(to_bggr(level), bayer)


@pytest.mark.parametrize("place", [(0, 0), (1, 1), (0, 31), (31, 31), (17, 10), (2, 28)])
@pytest.mark.parametrize("value", [0, 1023])
def test_dead_pixels_are_replaced_wherever_they_are(place, value):
    raw = raw_of(COLOURS)
    broken = raw.copy()
    broken[place] = value
    np.testing.assert_array_equal(correct_dead_pixels(broken, 128), raw)


def test_dead_pixel_correction_leaves_edges_and_noise():
    raw = raw_of(COLOURS)
    raw[:, 13:] -= 150
    noisy = raw + np.random.default_rng(0).integers(-20, 20, raw.shape)
    noisy = noisy.astype(np.uint16)
    np.testing.assert_array_equal(correct_dead_pixels(noisy, 128), noisy)


def test_two_dead_neighbours_of_one_filter():
    raw = raw_of(COLOURS)
    broken = raw.copy()
    broken[12, 12], broken[14, 14] = 0, 1023
    np.testing.assert_array_equal(correct_dead_pixels(broken, 128), raw)


def test_cell_means():
    rng = np.random.default_rng(1)
    level = rng.random((8, 12)).astype(np.float32)
    cells = cell_means(level)
    assert cells.shape == (2, 3, 4)
    cell = level[4:8, 8:12]
    assert cells[1, 2, 0] == pytest.approx((cell[0, 0] + cell[2, 2]) / 2)
    assert cells[1, 2, 2] == pytest.approx((cell[0, 2] + cell[2, 0]) / 2)
    assert cells[1, 2, 3] == pytest.approx(cell[1::2, 1::2].mean())
    assert cells[1, 2, 1] == pytest.approx(
        (cell.sum() - 2 * cells[1, 2, [0, 2]].sum() - cell[1::2, 1::2].sum()) / 8
    )


def test_crop_keeps_the_middle_and_the_pattern():
    raw = np.zeros((40, 64), np.uint16)
    raw[:, :] = 64 + np.arange(64, dtype=np.uint16) * 2
    processing = ImageProcessing(crop_px=(16, 32), downsample=8, alpha=0)
    rows, columns = processing.window(40, 64)
    assert (rows, columns) == (slice(12, 28), slice(16, 48))
    demosaiced, binned = processing.demosaic(raw), processing.bin_cells(raw)
    assert demosaiced.shape == binned.shape == (2, 4, 4)
    expected = (2 * np.arange(16, 48)).reshape(4, 8).mean(axis=1) * 255 / 1023
    assert np.abs(demosaiced - expected[:, None]).max() <= 1
    assert np.abs(binned.astype(int) - demosaiced).max() <= 1


@pytest.mark.parametrize(
    ("raw", "error", "message"),
    [
        (np.zeros((32, 30), np.uint16), MosaicError, "width = 30 px: expected a multiple of 4"),
        (np.zeros((33, 32), np.uint16), MosaicError, "height = 33 px"),
        (np.zeros((32, 32), np.uint8), ImageProcessingError, "uint8 .* expected uint16"),
        (np.zeros((2, 32, 32), np.uint16), ImageProcessingError, "expected uint16"),
        (np.full((32, 32), 1024, np.uint16), ImageProcessingError, "a pixel is 1024"),
        (np.zeros((4, 32), np.uint16), ImageProcessingError, "expected at least 8"),
    ],
)
@pytest.mark.parametrize("path", ["demosaic", "bin_cells"])
def test_refuses_what_is_no_raw_image(raw, error, message, path):
    with pytest.raises(error, match=message):
        getattr(ImageProcessing(), path)(raw)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"beta": 0.5}, "beta = 0.5: expected 1 to 1023"),
        ({"alpha": -1}, "alpha = -1"),
        ({"black_level_dn": 2000}, "black_level_dn = 2000"),
        ({"dead_pixel_dn": 0}, "dead_pixel_dn = 0"),
        ({"downsample": 0}, "downsample = 0"),
    ],
)
def test_refuses_impossible_settings(settings, message):
    with pytest.raises(ImageProcessingError, match=message):
        ImageProcessing(**settings)


def test_refuses_windows_and_factors_that_do_not_fit():
    raw = np.zeros((32, 32), np.uint16)
    for crop in ((36, 32), (32, 30), (32, 20)):
        with pytest.raises(ImageProcessingError, match="crop_px"):
            ImageProcessing(crop_px=crop, downsample=8).demosaic(raw)
    with pytest.raises(ImageProcessingError, match="downsample = 2: binning expects a multiple of 4"):
        ImageProcessing(downsample=2).bin_cells(raw)
