"""Measures of a frame's pixels, rows by rows, against those of integer.FrameValidity."""

import numpy as np
import pytest

from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.loops.measures import BRIGHTNESS, CHANGE, CLIPPED, DETAIL, measure


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (16, 17), (5, 300)])
def test_rows_add_up_to_the_frame(size, channels):
    rng = np.random.default_rng(1)
    background = rng.integers(0, 256, (*size, channels), dtype=np.uint8)
    dark, bright = np.zeros_like(background), np.full_like(background, 255)
    for frame in (background, dark, bright, rng.integers(0, 256, background.shape, dtype=np.uint8)):
        found, part = np.zeros(BRIGHTNESS + channels, np.int64), np.full(BRIGHTNESS + channels, 99)
        for first in range(0, size[0], 2):
            rows = min(2, size[0] - first)
            measure(frame.reshape(-1), background.reshape(-1), size[1], channels, first, rows, part)
            found += part
        validity = FrameValidity.unlimited(frame.shape, slopes=False, displacements=False)
        order = [CLIPPED, *range(BRIGHTNESS, BRIGHTNESS + channels), CHANGE, DETAIL]
        np.testing.assert_array_equal(found[order], validity.of_pixels(frame, background))
