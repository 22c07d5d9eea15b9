from itertools import product

import numpy as np
import pytest

from fastac.models.floating.hyperforce import collapse
from fastac.models.integer.depth import DisplacementQuantiser
from fastac.models.integer.force import PatchForce, WeightedSum, block_means, terms


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


class TestTerms:
    def test_without_a_band_it_is_the_displacement(self):
        q = np.arange(6).reshape(2, 3)
        np.testing.assert_array_equal(terms(q, ()), q[..., None])

    @pytest.mark.parametrize("band", [0, 3, 0.5])
    def test_what_is_beyond_the_band_has_terms_of_its_own(self, band):
        q = np.arange(-5, 6)
        found = terms(q, (band,))
        assert found.shape == (11, 3)
        for value, (whole, contact, bulge) in zip(q.tolist(), found.tolist(), strict=True):
            assert whole == value
            assert contact == (value - band if value > band else 0)
            assert bulge == (value + band if value < -band else 0)

    def test_what_is_deep_has_one_more(self):
        q = np.arange(-5, 6)
        found = terms(q, (1, 3))
        np.testing.assert_array_equal(found[:, :3], terms(q, (1,)))
        assert found[:, 3].tolist() == [0] * 9 + [1, 2]
        deeper = terms(q, (1, 3, 4))
        np.testing.assert_array_equal(deeper[:, :4], found)
        assert deeper[:, 4].tolist() == [0] * 10 + [1]

    def test_the_bound_of_three_terms_holds(self):
        """Each term is at most as large as the displacement, so the plain bound is enough."""
        rng = np.random.default_rng(1)
        force = WeightedSum(rng.integers(-99, 100, (2, 5, 5, 3)), np.zeros(2, int), 8, True)
        q = rng.choice([-force.input_limit, 0, force.input_limit], (200, 5, 5))
        assert terms(q, (0,)).dtype == np.int64
        assert np.abs(terms(q, (0,))).max() == force.input_limit
        assert force.bound / 4 < np.abs(force(terms(q, (0,)))).max() <= force.bound


class TestSquares:
    """Weights that all pixels of a square have in common."""

    @pytest.mark.parametrize("block_px", [1, 2, 4, 8])
    def test_means_of_squares(self, block_px):
        weights = np.random.default_rng(1).normal(size=(2, 6, 9, 3))
        found = block_means(weights, block_px)
        for row, column in product(range(6), range(9)):
            top, left = (k // block_px * block_px for k in (row, column))
            expected = weights[:, top : top + block_px, left : left + block_px].mean(axis=(1, 2))
            np.testing.assert_allclose(found[:, row, column], expected, rtol=1e-12)
        assert WeightedSum(found, np.zeros(2), 8, True, block_px=block_px).block_px == block_px, "not refused"
        np.testing.assert_allclose(block_means(found, block_px), found, rtol=1e-12)

    def test_means_of_the_weights_find_what_the_weights_find_in_means(self):
        rng = np.random.default_rng(3)
        weights, images = (rng.normal(size=(count, 6, 9, 3)) for count in (2, 4))
        found = np.einsum("aijt,nijt->na", block_means(weights, 4), images)
        np.testing.assert_allclose(found, np.einsum("aijt,nijt->na", weights, block_means(images, 4)))
        assert block_means(images.astype(np.float32), 4).dtype == np.float32

    def test_a_weight_for_each_square(self):
        of_squares = np.arange(12).reshape(1, 2, 3, 2)
        weight = of_squares.repeat(4, axis=1)[:, :6].repeat(4, axis=2)[:, :, :9]
        weighted = WeightedSum(weight, np.zeros(1, int), 8, True, block_px=4)
        np.testing.assert_array_equal(weighted.block_weight, of_squares)
        reversed_ = weighted.reversed_rows()
        assert reversed_.cut_rows == 2
        np.testing.assert_array_equal(reversed_.block_weight, of_squares[:, ::-1])
        again = reversed_.reversed_rows()
        assert again.cut_rows == 0
        np.testing.assert_array_equal(again.weight, weight)
        x = np.random.default_rng(2).integers(-127, 128, (6, 9, 2))
        assert weighted(x) == reversed_(x[::-1]) == WeightedSum(weight, np.zeros(1, int), 8, True)(x)

    @pytest.mark.parametrize(("block_px", "cut_rows"), [(0, 0), (3, 0), (-2, 0), (4, 4), (4, -1), (1, 1)])
    def test_refuses_squares_that_are_none(self, block_px, cut_rows):
        message = f"block_px = {block_px}, cut_rows = {cut_rows}: expected a power of two, and fewer rows"
        with pytest.raises(ValueError, match=message):
            WeightedSum(
                np.ones((1, 6, 9, 1), int), np.zeros(1, int), 8, True, block_px=block_px, cut_rows=cut_rows
            )

    @pytest.mark.parametrize("place", [(0, 1), (3, 0), (5, 8)])
    def test_refuses_squares_whose_pixels_differ(self, place):
        weight = np.ones((1, 6, 9, 1), int)
        weight[0, *place] = 2
        with pytest.raises(ValueError, match="weight: not the same in all squares of block_px = 4"):
            WeightedSum(weight, np.zeros(1, int), 8, True, block_px=4)
