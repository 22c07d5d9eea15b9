from fractions import Fraction
from itertools import product
from math import floor

import numpy as np
import pytest

from fastac.models.integer.network import GradientRatio, Layer, Requantisation


def nearest(value: Fraction) -> int:
    """Halves upwards."""
    return floor(value + Fraction(1, 2))


def requantised(a: int, multiplier: int, shift: int, bits: int) -> int:
    return min(floor(Fraction(multiplier * max(0, a), 2**shift)), 2**bits - 1)


class TestRequantisation:
    @pytest.mark.parametrize("bits", [3, 7])
    @pytest.mark.parametrize("shift", [0, 1, 17, 30, 47])
    def test_equals_the_paper_s_formula(self, shift, bits):
        multiplier = np.array([1, 3, 77_771, (1 << 17) - 1])
        rng = np.random.default_rng(shift)
        extremes = np.outer([0, 1, -1, 2**30, -(2**30), 2**24 - 1], np.ones(4, int))
        a = np.vstack([extremes, rng.integers(-(2**26), 2**26, (200, 4)), rng.integers(-300, 300, (100, 4))])
        found = Requantisation(multiplier, shift, bits)(a)
        expected = [
            [requantised(int(x), int(m), shift, bits) for x, m in zip(row, multiplier, strict=True)]
            for row in a
        ]
        assert found.tolist() == expected

    def test_by_hand(self):
        found = Requantisation(np.array([3]), 1)(np.array([[-5], [0], [1], [2], [84], [85], [10_000]]))
        np.testing.assert_array_equal(found[:, 0], [0, 0, 1, 3, 126, 127, 127])

    @pytest.mark.parametrize(
        ("multiplier", "shift", "message"),
        [
            ([1, 0], 1, "multiplier 0: expected at least 1"),
            ([1, -3], 1, "multiplier -3: expected at least 1"),
            ([1, 1 << 17], 1, "multiplier 1 to 131072: expected 0 to 131071"),
            ([1], -1, "shift -1: expected 0 to 47"),
            ([1], 48, "shift 48: expected 0 to 47"),
        ],
    )
    def test_refuses_what_the_hardware_cannot_do(self, multiplier, shift, message):
        with pytest.raises(ValueError, match=message):
            Requantisation(np.array(multiplier), shift)


def by_loop(weight, bias, x) -> list[list[int]]:
    return [
        [
            int(b) + sum(int(w) * int(v) for w, v in zip(row, pixel, strict=True))
            for row, b in zip(weight, bias, strict=True)
        ]
        for pixel in x
    ]


class TestLayer:
    @pytest.mark.parametrize(("weight_bits", "bias"), [(8, 1000), (16, 1 << 24), (16, 1 << 40)])
    def test_accumulates_exactly(self, weight_bits, bias):
        rng = np.random.default_rng(weight_bits)
        top = 1 << (weight_bits - 1)
        weight = rng.integers(-top, top, (5, 6))
        weight[0] = -top
        layer = Layer(
            weight, rng.integers(-bias, bias, 5), np.array([255, 255, 255, 255, 127, 127]), weight_bits
        )
        x = rng.integers(-127, 128, (50, 6))
        assert layer.accumulate(x).tolist() == by_loop(weight, layer.bias, x)
        np.testing.assert_array_equal(layer(x), layer.accumulate(x))
        # Features arrive in 16 bits: nothing may wrap in them.
        np.testing.assert_array_equal(layer(x.astype(np.int16)), layer(x))

    def test_requantises_each_neuron_with_its_own_multiplier(self):
        rng = np.random.default_rng(1)
        weight, bias = rng.integers(-127, 128, (3, 4)), rng.integers(-500, 500, 3)
        scale = Requantisation(np.array([1, 900, 70_000]), 20)
        x = rng.integers(-100, 100, (2, 9, 4))
        found = Layer(weight, bias, np.full(4, 127), 8, scale)(x)
        for pixel, value in zip(x.reshape(-1, 4), found.reshape(-1, 3), strict=True):
            (a,) = by_loop(weight, bias, [pixel])
            assert value.tolist() == [
                requantised(v, int(m), 20, 7) for v, m in zip(a, scale.multiplier, strict=True)
            ]

    def test_the_worst_signs_reach_the_bound(self):
        rng = np.random.default_rng(2)
        limit = np.array([255, 255, 255, 127, 127])
        weight, bias = rng.integers(-128, 128, (6, 5)), rng.integers(-4000, 4000, 6)
        layer = Layer(weight, bias, limit)
        reached = []
        for row, b in zip(weight, bias, strict=True):
            worst = np.where((row >= 0) == (b >= 0), limit, -limit)
            reached.append(np.abs(layer(worst[None])).max())
        assert max(reached) == layer.accumulator_bound
        assert layer.accumulator_bound < 2 ** (layer.accumulator_width - 1) <= 2 * layer.accumulator_bound

    def test_the_bound_counts_each_input_s_own_limit(self):
        layer = Layer(np.array([[100, 1], [0, -50]]), np.array([7, -3]), np.array([1, 1000]))
        assert layer.accumulator_bound == max(100 * 1 + 1 * 1000 + 7, 50 * 1000 + 3)

    @pytest.mark.parametrize(("value", "bits"), [(128, 8), (-129, 8), (2048, 12)])
    def test_refuses_weights_that_do_not_fit(self, value, bits):
        with pytest.raises(
            ValueError, match=f"weight .*expected {-(2 ** (bits - 1))} to {2 ** (bits - 1) - 1}"
        ):
            Layer(np.array([[value, 0]]), np.array([0]), np.array([1, 1]), bits)


def slope(n: int, n_z: int, fraction: int, limit: int) -> tuple[int, bool]:
    """−n/n_z: the magnitude to the nearest, halves up, clipped; and whether it was clipped."""
    if n_z <= 0:
        return (0 if n == 0 else -limit if n > 0 else limit), True
    magnitude = nearest(Fraction(abs(n) * 2**fraction, n_z))
    clipped = min(magnitude, limit)
    return (-clipped if n > 0 else clipped), magnitude > limit


class TestGradientRatio:
    def check(self, ratio: GradientRatio, normals: np.ndarray):
        slopes, saturated = ratio(normals)
        for normal, found, flags in zip(normals, slopes, saturated, strict=True):
            for axis in (0, 1):
                expected = slope(int(normal[axis]), int(normal[2]), ratio.fraction, ratio.limit)
                assert (found[axis], flags[axis]) == expected, normal

    @pytest.mark.parametrize(("width", "fraction"), [(17, 14), (8, 6), (19, 16), (4, 2)])
    def test_equals_exact_rational_division(self, width, fraction):
        rng = np.random.default_rng(width)
        ratio = GradientRatio(24, width, fraction)
        top = 1 << 23
        near = rng.integers(-600, 600, (300, 3))
        facing = np.column_stack([rng.integers(-top, top, (300, 2)), rng.integers(1, top, 300)])
        steep = np.column_stack([rng.integers(-top, top, (50, 2)), rng.integers(-2, 3, 50)])
        self.check(ratio, np.vstack([near, facing, steep]))

    def test_every_small_normal(self):
        """All halves, all signs, n_z below, at and above zero, and no normal at all."""
        self.check(GradientRatio(5, 6, 2), np.array(list(product(range(-8, 9), (-3, 0, 8), range(-4, 13)))))

    def test_halves_are_rounded_away_from_zero(self):
        slopes, saturated = GradientRatio(5, 6, 0)(np.array([[1, -1, 2], [3, -3, 2]]))
        np.testing.assert_array_equal(slopes, [[-1, 1], [-2, 2]])
        assert not saturated.any()

    @pytest.mark.parametrize("normal_width", [12, 24, 32])
    def test_most_negative_words(self, normal_width):
        low = -(1 << (normal_width - 1))
        ratio = GradientRatio(normal_width, 17, 14)
        self.check(
            ratio, np.array([[low, low, -low - 1], [low, 0, 1], [low, low, low], [0, -1, low], [low, 1, 0]])
        )

    def test_saturates_at_the_limit_and_says_so_only_beyond_it(self):
        ratio = GradientRatio(12, 5, 2)  # limit 15, i.e. a slope of 3.75
        slopes, saturated = ratio(np.array([[15, -15, 4], [31, -31, 8], [16, -16, 4], [0, 5, 0], [0, 0, 0]]))
        np.testing.assert_array_equal(slopes, [[-15, 15], [-15, 15], [-15, 15], [0, -15], [0, 0]])
        np.testing.assert_array_equal(saturated, [[0, 0], [1, 1], [1, 1], [1, 1], [1, 1]])

    def test_the_length_of_the_normal_does_not_count(self):
        n = np.random.default_rng(1).integers(-50, 50, (100, 3))
        ratio = GradientRatio(20, 17, 14)
        np.testing.assert_array_equal(ratio(n)[0], ratio(n * 37)[0])
