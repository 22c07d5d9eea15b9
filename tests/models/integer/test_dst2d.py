from fractions import Fraction
from math import floor

import numpy as np
import pytest

from fastac.models.integer.dst2d import EigenvalueDivision


def nearest(value: Fraction) -> int:
    """Halves upwards."""
    return floor(value + Fraction(1, 2))


ROUNDINGS = {"nearest": nearest, "floor": floor}


class TestEigenvalueDivision:
    @pytest.mark.parametrize("rounding", ROUNDINGS)
    def test_equals_the_rounded_product(self, rounding):
        rng = np.random.default_rng(1)
        mantissa = rng.integers(1 << 16, 1 << 17, (4, 4))
        mantissa = np.maximum(mantissa, mantissa.T)
        shift = rng.integers(1, 30, (4, 4))
        shift = np.maximum(shift, shift.T)
        shift[0] = shift[:, 0] = 1  # where the last place of the product still counts
        x = rng.integers(-(1 << 25), 1 << 25, (3, 4, 4))
        x[0] = -(1 << 25)
        found = EigenvalueDivision(mantissa, shift, 26, 30, rounding)(x)
        for index in np.ndindex(x.shape):
            exact = Fraction(-int(x[index]) * int(mantissa[index[1:]]), 2 ** int(shift[index[1:]]))
            assert found[index] == ROUNDINGS[rounding](exact)

    def test_product_width_holds_every_product(self):
        division = EigenvalueDivision(np.full((2, 2), (1 << 17) - 1), np.ones((2, 2), int), 26, 30)
        largest = (1 << 25) * ((1 << 17) - 1)
        assert largest < 1 << (division.product_width - 1) <= 2 * largest

    @pytest.mark.parametrize(
        ("mantissa", "shift", "message"),
        [
            ([[1 << 17]], [[1]], "mantissa .*expected 0 to 131071"),
            ([[-1]], [[1]], "mantissa -1 to -1: expected 0"),
            ([[1]], [[0]], "shift -1 to -1: expected 0 to 63"),
            ([[1]], [[65]], "shift 64 to 64: expected 0 to 63"),
            ([[1, 2], [3, 1]], [[1, 1], [1, 1]], "table: expected symmetric"),
            ([[1, 1], [1, 1]], [[1, 2], [3, 1]], "table: expected symmetric"),
        ],
    )
    def test_refusals(self, mantissa, shift, message):
        with pytest.raises(ValueError, match=message):
            EigenvalueDivision(np.array(mantissa), np.array(shift), 26, 30)

    def test_refuses_an_unknown_rounding(self):
        with pytest.raises(ValueError, match="rounding 'ceil': expected nearest or floor"):
            EigenvalueDivision(np.array([[1]]), np.array([[1]]), 26, 30, "ceil")
