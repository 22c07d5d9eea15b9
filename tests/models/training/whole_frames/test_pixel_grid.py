"""Rows and columns at equal distances."""

import numpy as np

from fastac.models.training.whole_frames.pixel_grid import WHOLE, every


def test_parts_are_the_whole():
    frame = np.arange(5 * 7).reshape(5, 7)
    np.testing.assert_array_equal(frame[WHOLE], frame)
    np.testing.assert_array_equal(frame[every(2, 1, 0)], frame[[1, 3]][:, [0, 2, 4, 6]])
    parts = [frame[every(3, row, column)].ravel() for row in range(3) for column in range(3)]
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), frame.ravel())
