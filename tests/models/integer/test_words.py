from fractions import Fraction
from math import floor

import numpy as np
import pytest

from fastac.models.integer.words import (
    Fixed,
    check_rounding,
    exact_matmul,
    fit,
    round_shift,
    signed_width,
    to_words,
)


@pytest.mark.parametrize(
    ("bound", "width"),
    [(0, 1), (1, 2), (2, 3), (3, 3), (4, 4), (127, 8), (128, 9), (255, 9), (256, 10), (2**40, 42)],
)
def test_signed_width_is_the_smallest_that_holds_both_signs(bound, width):
    assert signed_width(bound) == width
    assert bound <= 2 ** (width - 1) - 1
    if width > 1:
        assert bound > 2 ** (width - 2) - 1


def test_fixed_is_a_two_s_complement_word():
    word = Fixed(8, 3)
    assert word.limit == 127
    np.testing.assert_array_equal(word.to_float(np.array([-128, 1, 127])), [-16.0, 0.125, 15.875])


@pytest.mark.parametrize("width", [1, 63])
def test_fixed_refuses_widths_that_int64_cannot_handle(width):
    with pytest.raises(ValueError, match=f"width {width}: expected 2 to 62"):
        Fixed(width, 0)


def test_fit_gives_up_fraction_for_range():
    assert fit(3.0, width=16, fraction=8) == Fixed(11, 8)  # 3·256 + 1 = 769 needs 10 bits and a sign
    assert fit(100.0, width=12, fraction=8) == Fixed(12, 4)  # 100·16 + 1 = 1601 < 2047 < 100·32
    assert fit(2046.0, width=12, fraction=0) == Fixed(12, 0)
    assert fit(0.0, width=12, fraction=4) == Fixed(2, 4)


def test_fit_leaves_room_for_the_bound_and_one_rounding():
    rng = np.random.default_rng(1)
    for bound in rng.uniform(0, 1000, 300):
        word = fit(bound, width=14, fraction=9)
        assert word.limit >= Fraction(bound) * 2**word.fraction + 1
        # One more fractional bit would not have fitted, or was not asked for.
        assert word.fraction == 9 or Fraction(bound) * 2 ** (word.fraction + 1) + 1 > 2**13 - 1


def test_fit_refuses_what_even_whole_numbers_cannot_hold():
    with pytest.raises(ValueError, match="12 data bits cannot hold the bound 2047"):
        fit(2047.0, width=12, fraction=5)


def test_round_shift_is_to_the_nearest_and_halves_go_up():
    a = np.arange(-1000, 1000)
    for shift in (0, 1, 2, 5, 9):
        exact = [floor(Fraction(int(x), 2**shift) + Fraction(1, 2)) for x in a]
        np.testing.assert_array_equal(round_shift(a, shift), exact)
    np.testing.assert_array_equal(round_shift(np.array([-3, -1, 1, 3]), 1), [-1, 0, 1, 2])


def test_round_shift_cuts_off_with_a_floor():
    a = np.arange(-1000, 1000)
    for shift in (0, 1, 2, 5, 9):
        exact = [floor(Fraction(int(x), 2**shift)) for x in a]
        np.testing.assert_array_equal(round_shift(a, shift, "floor"), exact)
    np.testing.assert_array_equal(round_shift(np.array([-3, -1, 1, 3]), 1, "floor"), [-2, -1, 0, 1])


@pytest.mark.parametrize(("rounding", "half"), [("nearest", Fraction(1, 2)), ("floor", 0)])
def test_round_shift_takes_a_shift_for_each_value(rounding, half):
    a = np.array([2**42 + 3, -(2**42) - 3, 1000, -1000])
    shift = np.array([3, 3, 0, 40])
    exact = [floor(Fraction(int(x), 2 ** int(s)) + half) for x, s in zip(a, shift, strict=True)]
    np.testing.assert_array_equal(round_shift(a, shift, rounding), exact)


def test_there_are_two_roundings():
    for rounding in ("nearest", "floor"):
        check_rounding(rounding)
    with pytest.raises(ValueError, match="rounding 'up': expected nearest or floor"):
        check_rounding("up")


def product(a: np.ndarray, b: np.ndarray) -> list[list[int]]:
    """A matrix product in Python's unlimited integers."""
    return [[sum(int(x) * int(y) for x, y in zip(row, column, strict=True)) for column in b.T] for row in a]


@pytest.mark.parametrize("bits", [3, 11, 12, 25])
def test_exact_matmul_is_exact_up_to_its_bound(bits):
    """Odd values at the limits, so that a lost last place shows; 24 bits is float32's, 53 float64's."""
    rng = np.random.default_rng(bits)
    top = 2**bits - 1
    a = np.vstack([np.full((2, 7), top), np.full((1, 7), -top), rng.integers(-top, top + 1, (9, 7))])
    b = np.hstack([np.full((7, 1), top), rng.integers(-top, top + 1, (7, 4))])
    bound = 7 * top * top
    result = exact_matmul(a, b, bound)
    assert result.dtype == np.int64
    assert result.tolist() == product(a, b)
    assert np.abs(result).max() == bound


@pytest.mark.parametrize("total", [2**24 - 1, 2**24 + 1, 2**53 - 1])
def test_exact_matmul_changes_precision_where_it_must(total):
    """Sums of `total`, odd: float32 cannot hold 2**24 + 1."""
    a = np.array([[total - 1, 1]])
    assert exact_matmul(a, np.array([[1], [1]]), total)[0, 0] == total


def test_exact_matmul_refuses_what_float64_cannot_hold():
    with pytest.raises(ValueError, match=f"bound {2**53}: "):
        exact_matmul(np.ones((1, 1), int), np.ones((1, 1), int), 2**53)


def test_to_words_rounds_to_the_nearest_word():
    word = Fixed(6, 2)
    values = np.array([-7.75, -0.13, -0.12, 0.0, 0.12, 0.13, 7.87])
    np.testing.assert_array_equal(to_words(values, word), [-31, -1, 0, 0, 0, 1, 31])
    assert to_words(np.empty((0, 3)), word).shape == (0, 3)


@pytest.mark.parametrize("value", [8.0, -8.0, 7.9])
def test_to_words_refuses_what_does_not_fit(value):
    with pytest.raises(ValueError, match="does not fit"):
        to_words(np.array([0.0, value]), Fixed(6, 2))
