import numpy as np
import pytest

from fastac.models.integer.force import terms
from fastac.models.integer.force_segments import largest, segment_slopes

BENDS = [(0,), (3,), (0, 1), (2, 9), (2, 5, 9)]
LIMIT = 15


@pytest.mark.parametrize("bends", BENDS, ids=lambda bends: "/".join(map(str, bends)))
def test_slopes_are_what_the_sum_rises_by_within_each_segment(bends):
    weight = np.random.default_rng(1).integers(-20, 21, (2, 5, 2 + len(bends)))
    band, *deep = bends
    slopes = segment_slopes(weight)
    assert slopes.shape == weight.shape
    starts = [-band, band, -LIMIT, *deep]  # within the band, beyond it on either side, deeper than each bend
    for k, start in enumerate(starts):
        if k or band:
            rise = weight @ (terms(np.array(start + 1), bends) - terms(np.array(start), bends))
            assert (slopes[..., k] == rise).all()


@pytest.mark.parametrize("bends", BENDS, ids=lambda bends: "/".join(map(str, bends)))
def test_largest_magnitude_is_that_of_all_displacements(bends):
    weight = np.random.default_rng(2).integers(-20, 21, (3, 50, 2 + len(bends)))
    every = terms(np.arange(-LIMIT, LIMIT + 1), bends)
    np.testing.assert_array_equal(largest(weight, bends, LIMIT), np.abs(weight @ every.T).max(axis=-1))


def test_bends_beyond_the_limit_do_not_count():
    weight = np.array([[1, -3, 0]])
    assert largest(weight, (20,), LIMIT).tolist() == [LIMIT]
