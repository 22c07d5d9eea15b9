"""Few numbers of a frame, of which the force is a weighted sum: the lowest cosines of what is found."""

import numpy as np
import pytest
import torch
from scipy.fft import dctn

from fastac.models.training.whole_frames.force_features import (
    DISPLACEMENT_SIZE,
    SLOPES_SIZE,
    OfDisplacement,
    OfSlopes,
)
from fastac.models.training.whole_frames.pixel_grid import WHOLE, every

SHAPE = (12, 10)


@pytest.fixture
def change() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(5, *SHAPE, 2)).astype(np.float32)


def test_those_of_slopes_are_the_lowest_cosines(change):
    found = OfSlopes(SHAPE)(torch.from_numpy(change)).numpy()
    expected = dctn(change.astype(float), axes=(1, 2), norm="ortho")[:, :SLOPES_SIZE, :SLOPES_SIZE]
    np.testing.assert_allclose(found, expected.reshape(len(change), -1), atol=1e-5)


def test_some_rows_and_columns_stand_for_all(change):
    """Of a change that is the same everywhere, the cosines that such a part of the pixels can tell apart."""
    even = torch.from_numpy(change)[:, :1, :1].expand(-1, *SHAPE, -1)
    whole, part = (OfSlopes(SHAPE)(even[:, *grid], grid) for grid in (WHOLE, every(2, 1, 1)))
    lowest = [0, 1]
    torch.testing.assert_close(part[:, lowest], whole[:, lowest])


@pytest.mark.parametrize(("kernel_size", "side"), [(1, 1), (3, 3), (7, 3)])
@pytest.mark.parametrize("clamp", [False, True])
def test_those_of_the_displacement_are_the_lowest_cosines_of_each_neighbour(kernel_size, side, clamp):
    displacement = np.random.default_rng(2).normal(size=(4, 9, 9)).astype(np.float32)
    found = OfDisplacement(9, kernel_size, clamp=clamp)(torch.from_numpy(displacement)).numpy()
    known = np.maximum(displacement, 0) if clamp else displacement
    expected = []
    for down in range(-(side // 2), side // 2 + 1):
        for right in range(-(side // 2), side // 2 + 1):
            neighbour = np.zeros((4, 9, 9))
            for row in range(9):
                for column in range(9):
                    if 0 <= row + down < 9 and 0 <= column + right < 9:
                        neighbour[:, row, column] = known[:, row + down, column + right]
            lowest = dctn(neighbour, axes=(1, 2), norm="ortho")[:, :DISPLACEMENT_SIZE, :DISPLACEMENT_SIZE]
            expected.append(lowest.reshape(4, -1))
    np.testing.assert_allclose(found, np.concatenate(expected, axis=1), atol=1e-5)


def test_a_small_image_has_as_many_cosines_as_pixels():
    assert OfDisplacement(2, 1, clamp=True)(torch.ones(1, 2, 2)).shape == (1, 4)
    assert OfSlopes((2, 20))(torch.ones(1, 2, 20, 2)).shape == (1, 2 * SLOPES_SIZE * 2)
