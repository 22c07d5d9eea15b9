"""Weighted sums against NumPy's, on integers and on floats."""

import numpy as np
import pytest

from fastac.models.integer.force import terms
from fastac.models.loops.weights import weigh, weigh_terms


@pytest.mark.parametrize("count", [0, 1, 7, 256])
def test_a_sum(count):
    rng = np.random.default_rng(1)
    values, weight = rng.integers(-99, 100, (2, 300)).astype(float)
    assert weigh(values[:count], weight) == values[:count] @ weight[:count]


@pytest.mark.parametrize("bends", [(), (3,), (3, 20)])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_all_terms(bends, kind):
    rng = np.random.default_rng(1)
    values, first = rng.integers(-50, 51, 40).astype(kind), 5
    expected = terms(values.astype(float), bends)
    weight = rng.integers(-9, 10, (2, expected.shape[1], 50)).astype(float)
    share = np.full(2, np.nan)
    weigh_terms(values, np.array(bends, kind), weight, first, share)
    np.testing.assert_array_equal(share, np.einsum("pt,atp->a", expected, weight[..., first : first + 40]))
