from fractions import Fraction
from math import floor

import numpy as np
import pytest

from fastac.models.integer.sine_transform import SineTransform


def nearest(value: Fraction) -> int:
    """Halves upwards."""
    return floor(value + Fraction(1, 2))


ROUNDINGS = {"nearest": nearest, "floor": floor}


class TestSineTransform:
    @staticmethod
    def matrix(n: int, fraction: int) -> np.ndarray:
        from math import pi, sin, sqrt

        one = [
            [round(2**fraction * sqrt(2 / (n + 1)) * sin(pi * (k + 1) * (m + 1) / (n + 1))) for m in range(n)]
            for k in range(n)
        ]
        return np.array(one)

    @pytest.mark.parametrize("rounding", ROUNDINGS)
    @pytest.mark.parametrize(("n", "input_width", "shift"), [(5, 8, 3), (8, 20, 13), (9, 26, 17)])
    def test_equals_the_rounded_product(self, n, input_width, shift, rounding):
        transform = SineTransform(self.matrix(n, 17), shift, input_width, 40, rounding)
        rounded = ROUNDINGS[rounding]
        limit = 1 << (input_width - 1)
        rng = np.random.default_rng(n)
        rows = np.vstack([np.full(n, -limit), np.full(n, limit - 1), rng.integers(-limit, limit, (20, n))])
        matrix = transform.matrix.tolist()
        expected = [
            [
                rounded(Fraction(sum(c * int(x) for c, x in zip(coefficients, row, strict=True)), 2**shift))
                for coefficients in matrix
            ]
            for row in rows
        ]
        assert transform(rows).tolist() == expected
        assert transform(rows.reshape(2, -1, n)).shape == (2, len(rows) // 2, n)

    @pytest.mark.parametrize(("rounding", "half"), [("nearest", 16), ("floor", 0)])
    def test_the_worst_signs_reach_the_accumulator_s_bound(self, rounding, half):
        transform = SineTransform(self.matrix(6, 12), 5, 10, 30, rounding)
        assert transform.half_unit == half
        row = transform.matrix[np.abs(transform.matrix).sum(axis=1).argmax()]
        # Only the most negative word has the magnitude 2**9, so one sign of the two reaches it.
        worst = np.where(row > 0, -512, 511)
        reached = abs(int(sum(int(a) * int(b) for a, b in zip(row, worst, strict=True))))
        assert reached <= transform.accumulator_bound
        assert transform.accumulator_bound == int(np.abs(row).sum()) * 512 + half
        assert transform.accumulator_bound < 2 ** (transform.accumulator_width - 1)
        assert reached > 0.99 * transform.accumulator_bound

    def test_coefficient_width_holds_the_largest_coefficient(self):
        transform = SineTransform(self.matrix(6, 12), 5, 10, 30)
        largest = int(transform.matrix.max())
        assert 2 ** (transform.coefficient_width - 2) <= largest < 2 ** (transform.coefficient_width - 1)

    def test_refusals(self):
        with pytest.raises(ValueError, match=r"matrix \(2, 3\): expected square and symmetric"):
            SineTransform(np.ones((2, 3), int), 1, 8, 8)
        with pytest.raises(ValueError, match="expected square and symmetric"):
            SineTransform(np.array([[1, 2], [3, 1]]), 1, 8, 8)
        with pytest.raises(ValueError, match="shift 0: expected at least 1"):
            SineTransform(np.eye(2, dtype=int), 0, 8, 8)
        with pytest.raises(ValueError, match="rounding 'ceil': expected nearest or floor"):
            SineTransform(np.eye(2, dtype=int), 1, 8, 8, "ceil")
