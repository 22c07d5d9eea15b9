"""Each stage against the sentence in its docstring, written out in Python's unlimited integers."""

from fractions import Fraction
from itertools import product
from math import floor

import numpy as np
import pytest

from fastac.models.floating.hyperforce import collapse
from fastac.models.integer.depth import Depth, DisplacementQuantiser
from fastac.models.integer.dst2d import EigenvalueDivision
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.laplacian import divergence_of
from fastac.models.integer.network import GradientRatio, Layer, Requantisation
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource


def nearest(value: Fraction) -> int:
    """Halves upwards."""
    return floor(value + Fraction(1, 2))


ROUNDINGS = {"nearest": nearest, "floor": floor}


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


def source_by_loop(slopes: np.ndarray, divergence: str) -> list[list[int]]:
    p, q = slopes[..., 0].tolist(), slopes[..., 1].tolist()
    height, width = slopes.shape[:2]
    back = 1
    ahead = 1 if divergence == "central" else 0
    return [
        [p[i][j + ahead] - p[i][j - back] + q[i + ahead][j] - q[i - back][j] for j in range(1, width - 1)]
        for i in range(1, height - 1)
    ]


class TestPoissonSource:
    @pytest.mark.parametrize("divergence", ["central", "backward"])
    def test_equals_differences_of_neighbours(self, divergence):
        rng = np.random.default_rng(1)
        slopes = rng.integers(-(2**16), 2**16, (2, 7, 7, 2))
        offset = rng.integers(-1000, 1000, (5, 5))
        found = PoissonSource(divergence, 17, offset)(slopes)
        for frame, one in zip(slopes, found, strict=True):
            np.testing.assert_array_equal(one, np.array(source_by_loop(frame, divergence)) - offset)

    @pytest.mark.parametrize("divergence", ["central", "backward"])
    def test_the_worst_signs_reach_the_bound(self, divergence):
        limit = 2**7 - 1
        offset = np.zeros((4, 4), int)
        offset[2, 1] = -50
        source = PoissonSource(divergence, 8, offset)
        # The linear map to pixel (2, 1) by unit slopes, then the signs that make all of it add up.
        weight = np.zeros((6, 6, 2), int)
        for index in np.ndindex(weight.shape):
            unit = np.zeros_like(weight)
            unit[index] = 1
            weight[index] = divergence_of(unit, divergence)[2, 1]
        assert np.abs(weight).sum() == source.terms
        assert source(np.sign(weight) * limit)[2, 1] == source.bound == 4 * limit + 50
        assert source.bound < 2 ** (source.width - 1)

    def test_unit_slopes_of_a_plane_have_no_source(self):
        plane = np.broadcast_to([3, -5], (6, 8, 2))
        for divergence in ("central", "backward"):
            assert not divergence_of(plane, divergence).any()
            assert divergence_of(plane, divergence).shape == (4, 6)

    def test_refuses_an_unknown_divergence(self):
        with pytest.raises(ValueError, match="divergence 'forward': expected central or backward"):
            PoissonSource("forward", 8, np.zeros((4, 4), int))


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


class TestDepth:
    rest = np.array([[10, -20], [0, 127]])

    def test_absolute_depth_is_the_solution_and_displacement_what_is_missing_from_rest(self):
        z = np.array([[[4, -30], [-128, 127]]])
        depth, displacement = Depth("absolute", 8, self.rest)(z)
        np.testing.assert_array_equal(depth, z)
        np.testing.assert_array_equal(displacement, [[[6, 10], [128, 0]]])

    def test_difference_is_added_to_the_skin(self):
        z = np.array([[[4, -30], [-128, 127]]])
        depth, displacement = Depth("difference", 8, self.rest)(z)
        np.testing.assert_array_equal(depth, [[[14, -50], [-128, 254]]])
        np.testing.assert_array_equal(displacement, -z)

    @pytest.mark.parametrize("mode", ["absolute", "difference"])
    @pytest.mark.parametrize("top", [0, 5, 127, -128])
    def test_the_width_holds_the_most_extreme_words(self, mode, top):
        stage = Depth(mode, 8, np.array([[top]]))
        for z in (-128, 127):
            for value in stage(np.array([[z]])):
                assert -(2 ** (stage.width - 1)) <= value[0, 0] < 2 ** (stage.width - 1)

    def test_refuses_an_unknown_mode(self):
        with pytest.raises(ValueError, match="mode 'relative': expected absolute or difference"):
            Depth("relative", 8, self.rest)


class TestDisplacementQuantiser:
    @pytest.mark.parametrize(("shift", "bits"), [(0, 4), (1, 4), (3, 5), (12, 12)])
    def test_equals_the_paper_s_formula(self, shift, bits):
        top = 2**bits - 1
        edge = top << shift
        d = np.concatenate([np.arange(-40, 400), edge + np.arange(-20, 20), [-(2**30), 2**30]])
        words, saturated = DisplacementQuantiser(32, shift, bits)(d)
        for value, word, flag in zip(d.tolist(), words, saturated, strict=True):
            exact = nearest(Fraction(max(value, 0), 2**shift))
            assert (word, flag) == (min(exact, top), exact > top)
        assert saturated.any()

    @pytest.mark.parametrize(("shift", "bits"), [(0, 4), (1, 4), (3, 5), (12, 12)])
    def test_without_the_clamp_both_signs_round_upwards_and_saturate(self, shift, bits):
        top = 2 ** (bits - 1) - 1
        edge = (top << shift) + np.arange(-20, 20)
        d = np.concatenate([np.arange(-400, 400), edge, -edge, [-(2**30), 2**30]])
        quantiser = DisplacementQuantiser(32, shift, bits, clamp=False)
        assert quantiser.top == top
        words, saturated = quantiser(d)
        for value, word, flag in zip(d.tolist(), words, saturated, strict=True):
            exact = nearest(Fraction(value, 2**shift))
            assert (word, flag) == (max(-top, min(exact, top)), abs(exact) > top)
        assert saturated[d < 0].any()
        assert saturated[d > 0].any()

    def test_bulges_are_no_saturation(self):
        words, saturated = DisplacementQuantiser(10, 2, 4)(np.array([-512, -1, 0]))
        assert not words.any()
        assert not saturated.any()


def force_by_loop(kernel: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pixel-wise responses and their sum, by the definition."""
    axes, n, _, k, _ = kernel.shape
    half = k // 2
    responses = np.zeros((axes, n, n), dtype=np.int64)
    for a, i, j in product(range(axes), range(n), range(n)):
        total = 0
        for di, dj in product(range(k), range(k)):
            v, u = i + di - half, j + dj - half
            if 0 <= v < n and 0 <= u < n:
                total += int(kernel[a, i, j, di, dj]) * int(q[v, u])
        responses[a, i, j] = total
    return responses, responses.sum(axis=(1, 2))


class TestPatchForce:
    @pytest.mark.parametrize(("n", "k", "axes"), [(6, 3, 2), (7, 5, 1), (5, 1, 3), (4, 7, 1)])
    def test_equals_the_quadruple_loop(self, n, k, axes):
        rng = np.random.default_rng(n)
        force = PatchForce(rng.integers(-128, 128, (axes, n, n, k, k)), 8, 12)
        assert force.size == k
        frames = rng.integers(0, 4096, (3, n, n))
        for q, responses, total in zip(frames, force.force_map(frames), force(frames), strict=True):
            expected, resultant = force_by_loop(force.kernel, q)
            np.testing.assert_array_equal(responses, expected)
            np.testing.assert_array_equal(total, resultant)

    @pytest.mark.parametrize("corner", [(0, 0), (0, 5), (5, 0), (5, 5)])
    def test_one_bright_pixel_in_a_corner(self, corner):
        """It is seen by the four kernels that reach it, each through another weight."""
        rng = np.random.default_rng(1)
        force = PatchForce(rng.integers(1, 128, (1, 6, 6, 3, 3)), 8, 12)
        q = np.zeros((6, 6), dtype=np.int64)
        q[corner] = 1000
        found = force.force_map(q)[0]
        assert np.count_nonzero(found) == 4
        for i, j in np.argwhere(found):
            weight = force.kernel[0, i, j, corner[0] - i + 1, corner[1] - j + 1]
            assert found[i, j] == 1000 * weight
        np.testing.assert_array_equal(found, force_by_loop(force.kernel, q)[0][0])

    def test_one_weight_per_pixel_gives_the_same_resultant_bit_for_bit(self):
        rng = np.random.default_rng(2)
        force = PatchForce(rng.integers(-128, 128, (2, 8, 8, 5, 5)), 8, 12)
        q = rng.integers(0, 4096, (10, 8, 8))
        weight = np.zeros((2, 8, 8), dtype=np.int64)
        for a, i, j, di, dj in np.ndindex(force.kernel.shape):
            v, u = i + di - 2, j + dj - 2
            if 0 <= v < 8 and 0 <= u < 8:
                weight[a, v, u] += force.kernel[a, i, j, di, dj]
        np.testing.assert_array_equal(force(q), np.einsum("fij,aij->fa", q, weight))
        np.testing.assert_array_equal(collapse(force.kernel), weight)

    @pytest.mark.parametrize("k", [1, 3, 5, 7])
    @pytest.mark.parametrize("signed", [False, True])
    @pytest.mark.parametrize("n", [7, 8])
    def test_collapsed_kernels_are_bit_identical(self, n, signed, k):
        """All saturated, one bright pixel in every corner, any frame."""
        rng = np.random.default_rng(k)
        force = PatchForce(rng.integers(-128, 128, (3, n, n, k, k)), 8, 12, signed)
        top = force.displacement_limit
        q = rng.integers(-top if signed else 0, top + 1, (12, n, n))
        q[0], q[1:5], q[5] = top, 0, -top if signed else 0
        for frame, corner in enumerate([(0, 0), (0, -1), (-1, 0), (-1, -1)], start=1):
            q[(frame, *corner)] = top
        collapsed = force.collapsed()
        assert collapsed.weight.shape == (3, n, n, 1)
        assert (collapsed.input_width, collapsed.input_signed) == (12, signed)
        assert collapsed.input_limit == top
        assert not collapsed.constant.any()
        assert collapsed.bound <= force.bound, "weights of one pixel may cancel, and the rim's are dropped"
        np.testing.assert_array_equal(collapsed(q[..., None]), force(q))

    @pytest.mark.parametrize("signed", [False, True])
    def test_largest_displacement_is_the_quantiser_s_largest_word(self, signed):
        force = PatchForce(np.ones((1, 4, 4, 1, 1), int), 8, 9, signed)
        assert force.displacement_limit == DisplacementQuantiser(20, 2, 9, clamp=not signed).top
        assert force.bound == 16 * force.displacement_limit

    def test_bounds_are_reached_inside_and_hold_everywhere(self):
        rng = np.random.default_rng(3)
        kernel = rng.integers(0, 128, (2, 6, 6, 3, 3))
        kernel[:, 2, 3] = 127
        force = PatchForce(kernel, 8, 10)
        q = np.full((6, 6), 1023)
        assert force.force_map(q).max() == force.pixel_bound == 9 * 127 * 1023
        assert force(q).max() <= force.bound == kernel.sum(axis=(1, 2, 3, 4)).max() * 1023
        assert force.pixel_bound < 2 ** (force.pixel_width - 1) <= 2 * force.pixel_bound
        assert force.bound < 2 ** (force.width - 1) <= 2 * force.bound
        # A kernel that weighs only its own pixel loses nothing at the rim: it reaches the whole bound.
        centre = np.zeros((1, 4, 4, 3, 3), dtype=np.int64)
        centre[..., 1, 1] = -128
        alone = PatchForce(centre, 8, 10)
        assert alone(np.full((4, 4), 1023))[0] == -alone.bound

    def test_refuses_kernels_that_do_not_fit(self):
        with pytest.raises(ValueError, match="kernel 0 to 128: expected -128 to 127"):
            PatchForce(np.array([0, 128] * 2).reshape(1, 2, 2, 1, 1), 8, 12)


class TestWeightedSum:
    @pytest.mark.parametrize(("axes", "rows", "columns", "terms"), [(1, 4, 6, 1), (3, 5, 3, 2), (2, 1, 1, 3)])
    @pytest.mark.parametrize("signed", [False, True])
    def test_equals_the_sum_by_the_definition(self, axes, rows, columns, terms, signed):
        rng = np.random.default_rng(axes)
        weight = rng.integers(-(2**17), 2**17, (axes, rows, columns, terms))
        constant = rng.integers(-(2**30), 2**30, axes)
        weighted = WeightedSum(weight, constant, 17, signed)
        limit = weighted.input_limit
        assert limit == (2**16 - 1 if signed else 2**17 - 1)
        x = rng.integers(-limit if signed else 0, limit + 1, (5, rows, columns, terms))
        flat = weight.reshape(axes, -1).tolist()
        expected = [
            [
                c + sum(w * v for w, v in zip(words, frame, strict=True))
                for c, words in zip(constant.tolist(), flat, strict=True)
            ]
            for frame in x.reshape(5, -1).tolist()
        ]
        assert weighted(x).tolist() == expected
        assert weighted(x[0]).tolist() == expected[0]

    def test_the_worst_signs_reach_the_bound(self):
        rng = np.random.default_rng(1)
        weight, constant = rng.integers(-99, 100, (2, 3, 4, 2)), np.array([-5000, 70])
        weighted = WeightedSum(weight, constant, 10, True)
        worst = 511 * np.sign(weight * constant[:, None, None, None])  # one frame for each axis
        assert np.abs(np.diag(weighted(worst))).max() == weighted.bound
        assert weighted.bound < 2 ** (weighted.width - 1) <= 2 * weighted.bound
        assert 2 ** (weighted.weight_width - 2) <= np.abs(weight).max() < 2 ** (weighted.weight_width - 1)

    def test_no_weights_leave_the_constant(self):
        weighted = WeightedSum(np.zeros((2, 3, 3, 1), int), np.array([7, -9]), 8, False)
        assert weighted.bound == 9
        assert weighted(np.full((4, 3, 3, 1), 255)).tolist() == [[7, -9]] * 4

    @pytest.mark.parametrize(("shape", "constants"), [((2, 3, 3, 1), 1), ((2, 3, 3), 2)])
    def test_refuses_shapes_that_do_not_belong_together(self, shape, constants):
        with pytest.raises(ValueError, match=r"expected \(axes, rows, columns, terms\) and \(axes,\)"):
            WeightedSum(np.ones(shape, int), np.zeros(constants, int), 8, False)
