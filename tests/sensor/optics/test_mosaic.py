import numpy as np
import pytest

from fastac.sensor.optics.mosaic import LAYOUT, MosaicError, mosaic


def test_layout_is_what_the_paper_says():
    assert np.bincount(LAYOUT.ravel()).tolist() == [2, 8, 2, 4]
    assert (LAYOUT[1::2, 1::2] == 3).all(), "NIR at odd rows and columns"
    assert LAYOUT[0, 0] == 0, "BGGR begins with blue"
    green = np.add.outer(np.arange(4), np.arange(4)) % 2 == 1
    np.testing.assert_array_equal(LAYOUT == 1, green)


def test_each_pixel_sees_its_filter_and_its_share_of_nir():
    light = np.random.default_rng(0).random((2, 8, 12, 4))
    image = mosaic(light, (0.1, 0.2, 0.3))
    assert image.shape == (2, 8, 12)
    assert image[1, 0, 0] == light[1, 0, 0, 0] + 0.1 * light[1, 0, 0, 3]
    assert image[1, 4, 5] == light[1, 4, 5, 1] + 0.2 * light[1, 4, 5, 3]
    assert image[0, 6, 4] == light[0, 6, 4, 2] + 0.3 * light[0, 6, 4, 3]
    np.testing.assert_array_equal(image[:, 1::2, 1::2], light[:, 1::2, 1::2, 3])


def test_refuses_broken_cells_and_other_channels():
    with pytest.raises(MosaicError, match="width = 10 px: expected a multiple of 4"):
        mosaic(np.zeros((8, 10, 4)), (0, 0, 0))
    with pytest.raises(MosaicError, match=r"expected \(…, height, width, 4\)"):
        mosaic(np.zeros((8, 8, 3)), (0, 0, 0))
