from dataclasses import replace

import numpy as np
import pytest

from fastac.sensor import samples
from fastac.sensor.dataset import DatasetError


def test_choose_takes_a_split_or_all(tiny_data, tmp_path):
    np.testing.assert_array_equal(samples.split_indices(tiny_data, "all", tmp_path), np.arange(34))
    chosen = samples.split_indices(tiny_data, "validation", tmp_path)
    assert set(tiny_data.split[chosen]) == {"validation"}
    assert len(chosen) == 8
    train_only = replace(tiny_data, split=np.full(34, "train"))
    with pytest.raises(DatasetError, match=f"{tmp_path}: split: no frame is in 'test'"):
        samples.split_indices(train_only, "test", tmp_path)


@pytest.mark.parametrize(
    ("size", "count", "expected"),
    [(9, 3, [0, 4, 8]), (10, 2, [0, 9]), (3, 3, [0, 1, 2]), (2, 5, [0, 1]), (1, 4, [0])],
)
def test_spread_reaches_from_the_first_to_the_last(size, count, expected):
    index = np.arange(size) * 10 + 3
    np.testing.assert_array_equal(samples.evenly_spaced(index, count), index[expected])
