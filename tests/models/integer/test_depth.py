from fractions import Fraction
from math import floor

import numpy as np
import pytest

from fastac.models.integer.depth import Depth, DisplacementQuantiser


def nearest(value: Fraction) -> int:
    """Halves upwards."""
    return floor(value + Fraction(1, 2))


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
