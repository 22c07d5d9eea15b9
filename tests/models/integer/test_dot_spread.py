"""The spread of touching dots about the rigid motion that fits them: by least squares, and its bounds."""

from dataclasses import replace

import dots
import numpy as np
import pytest
import slips

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.dot_spread import LEAST_DOTS, DotSpread, spread_px, spread_words
from fastac.models.vision.rigid_spread import rigid_spread_px

SIDE, LIMIT = 46, 700
GRID = np.stack(np.meshgrid(*2 * [3 + 10 * np.arange(4)]), axis=-1).reshape(-1, 2)
"""4 × 4 places; the middle is half a pixel beside one."""


@pytest.fixture(scope="module")
def spread():
    return DotSpread(GRID, 20, LIMIT)


def touching(spread: DotSpread, contact: np.ndarray) -> np.ndarray:
    """Displacements (..., N, N) of which those of `contact` (..., M) alone are beyond the threshold."""
    column, row = spread.place.T
    found = np.zeros((*contact.shape[:-1], SIDE, SIDE), int)
    found[..., row, column] = spread.threshold + contact
    return found


def of_contact(spread: DotSpread, shifts: np.ndarray, contact: np.ndarray):
    """Spreads and numbers of dots of shifts (..., M, 2), all dots seen."""
    return spread(shifts, np.ones(contact.shape, bool), touching(spread, contact))


def random_cases(spread: DotSpread, count: int):
    """Shifts (count, M, 2) and contacts (count, M), of few dots and of many."""
    rng = np.random.default_rng(1)
    shape = (count, len(spread.place))
    shifts = rng.integers(-spread.shift_limit, spread.shift_limit + 1, (*shape, 2))
    return shifts, rng.random(shape) < rng.random((count, 1))


def test_equals_the_least_squares_of_floats_rounded_down(spread):
    shifts, contact = random_cases(spread, 300)
    shifts[::3] //= 200
    found, count = of_contact(spread, shifts, contact)
    np.testing.assert_array_equal(count, contact.sum(axis=1))
    px = np.array(
        [
            rigid_spread_px(spread.place[touch], shift[touch])
            for touch, shift in zip(contact, shifts, strict=True)
        ]
    )
    enough = count >= LEAST_DOTS
    rest = px**2 - found
    assert (found[enough] > 0).mean() > 0.9
    assert (rest > -1e-6).all()
    assert (rest < 1 + 1e-6).all()
    assert 0.3 < rest[enough].mean() < 0.7, "rounded down, not to the nearest"
    assert not found[~enough].any()
    assert not rest[~enough].any()
    assert {0, 1, 2} < set(count.tolist())


def test_a_translation_leaves_nothing(spread):
    _, contact = random_cases(spread, 20)
    shifts = np.broadcast_to(np.array((LIMIT, -37)), (*contact.shape, 2))
    assert not of_contact(spread, shifts, contact)[0].any()


@pytest.mark.parametrize("centre", [(0, 0), (18, 18), (-900, 400)])
def test_a_small_rotation_about_any_centre_leaves_nothing(spread, centre):
    """`turn` sixty-fourths of a pixel for each pixel of distance, so that shifts are whole."""
    _, contact = random_cases(spread, 20)
    x, y = (spread.place - centre).T
    for turn in (1, -3):
        shifts = np.broadcast_to(np.stack([-turn * y, turn * x], axis=-1), (*contact.shape, 2))
        assert not of_contact(spread, shifts, contact)[0].any()


def test_a_rigid_motion_of_all_changes_nothing(spread):
    shifts, contact = random_cases(spread, 60)
    shifts //= 4
    x, y = spread.place.T
    moved = shifts + np.stack([40 - 2 * y, 2 * x - 90], axis=-1)
    expected, _ = of_contact(spread, shifts, contact)
    assert expected.any()
    np.testing.assert_array_equal(of_contact(spread, moved, contact)[0], expected)


def test_places_count_from_wherever_one_likes(spread):
    """From the corner the sums are larger, and what follows from them is the same."""
    shifts, contact = random_cases(spread, 60)
    away = DotSpread(GRID + np.array((5, 2)), 20, LIMIT)
    assert (away.xy == spread.xy).all()
    assert away.bounds == spread.bounds
    expected = of_contact(spread, shifts, contact)
    for found, known in zip(of_contact(away, shifts, contact), expected, strict=True):
        np.testing.assert_array_equal(found, known)


def test_one_dot_of_four_that_stays_behind(spread):
    """By hand: of four dots at the corners of a square, one lags by 8 along u. The mean motion is a quarter
    of that, the rotation takes a part: 8²/4 (1 − 1/4 − 1/8) = 10 is left."""
    corners = np.isin(np.arange(len(GRID)), (0, 3, 12, 15))
    shifts = np.full((len(GRID), 2), 100)
    shifts[0, 0] -= 8
    found, count = of_contact(spread, shifts, corners)
    assert (int(found), int(count)) == (10, 4)


def test_dots_that_do_not_touch_or_are_not_seen_have_no_part(spread):
    shifts, contact = random_cases(spread, 40)
    expected, count = of_contact(spread, shifts, contact)
    wild = np.where(contact[..., None], shifts, -shifts // 2 + 5)
    np.testing.assert_array_equal(of_contact(spread, wild, contact)[0], expected)
    everywhere = np.full((len(contact), SIDE, SIDE), spread.threshold + 1)
    for found, known in zip(spread(wild, contact, everywhere), (expected, count), strict=True):
        np.testing.assert_array_equal(found, known)


def test_the_displacement_is_beyond_the_threshold_at_the_dot_s_own_pixel(spread):
    column, row = GRID[6]
    displacement = np.full((SIDE, SIDE), spread.threshold)
    seen = np.ones(len(GRID), bool)
    assert not spread.contact(displacement, seen).any()
    displacement[row, column] += 1
    assert np.flatnonzero(spread.contact(displacement, seen)).tolist() == [6]
    displacement[row, column] = -100
    assert not spread.contact(displacement, seen).any()


def test_bounds_are_reached(spread):
    """Where they are not, no registers are much too wide."""
    shifts, contact = slips.extremes(spread)
    found = [slips.sums(spread, *frame) for frame in zip(shifts, contact, strict=True)]
    reached = {name: max(abs(sums[name]) for sums in found) for name in found[0]}
    reached["spread"] = of_contact(spread, shifts, contact)[0].max()
    assert reached.pop("C") > 0.99 * spread.bounds["C"]
    assert reached == {name: spread.bounds[name] for name in reached}
    assert len(reached) == len(spread.bounds) - 1


def test_bounds_hold():
    """Over contacts and signs at random, on places that are not symmetric."""
    follower = dots.follower(48, 48)
    spread = DotSpread.of_follower(follower, 0)
    bounds, rng = spread.bounds, np.random.default_rng(2)
    for _ in range(300):
        contact = rng.random(len(spread.place)) < rng.random()
        if rng.random() < 0.5:
            contact &= spread.xy @ rng.normal(size=2) > 0
        shifts = follower.bound * rng.choice([-1, 1], (len(contact), 2))
        found = slips.sums(spread, shifts, contact)
        found["spread"] = int(of_contact(spread, shifts, contact)[0])
        assert found.keys() == bounds.keys()
        assert {name: value for name, value in found.items() if abs(value) > bounds[name]} == {}


def test_products_of_more_than_64_bits():
    """All dots of a large image, also of a single frame."""
    places = 2 + 4 * np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2)
    spread = DotSpread(places, 0, 20_000)
    assert spread.bounds["A"] * spread.bounds["C"] > 1 << 70
    displacement = np.ones((2, 162, 162), int)
    shifts = np.random.default_rng(3).integers(-20_000, 20_001, (2, len(places), 2))
    seen = np.ones(shifts.shape[:2], bool)
    both, count = spread(shifts, seen, displacement)
    assert count.tolist() == 2 * [1600]
    for k, shift in enumerate(shifts):
        found = slips.sums(spread, shift, seen[k])
        a, b, c = (found[name] for name in "ABC")
        expected = (a * c - b * b) // (1600**2 * c)
        assert expected == both[k] == spread(shift, seen[k], displacement[k])[0]


def test_leading_axes_are_kept(spread):
    shifts, contact = random_cases(spread, 6)
    flat = of_contact(spread, shifts, contact)
    nested = of_contact(spread, shifts.reshape(2, 3, -1, 2), contact.reshape(2, 3, -1))
    for found, known in zip(nested, flat, strict=True):
        assert (found.shape, found.dtype) == ((2, 3), np.int64)
        np.testing.assert_array_equal(found.ravel(), known)


def test_dots_of_a_follower_on_the_rim_are_looked_up_beside_it():
    """The displacement has no values on the image's rim: its first is that of pixel 1, 1."""
    usual = dots.follower(48, 40)
    rest = usual.rest.copy()
    rest[0], rest[-1] = (0, 0), (39 << FRACTION, 47 << FRACTION)
    follower = replace(usual, rest=rest)
    spread = DotSpread.of_follower(follower, 3)
    assert spread.place[[0, -1]].tolist() == [[0, 0], [37, 45]]
    np.testing.assert_array_equal(spread.place[1:-1], follower.rest_px[1:-1] - 1)
    assert (spread.threshold, spread.shift_limit) == (3, follower.bound)


@pytest.mark.parametrize("count", [1, 2])
def test_a_sensor_with_too_few_dots_has_no_spread(count):
    spread = DotSpread(GRID[:count], 0, LIMIT)
    shifts = np.array([[LIMIT, -LIMIT], [0, LIMIT]])[:count]
    found, touched = of_contact(spread, shifts, np.ones(count, bool))
    assert (int(found), int(touched)) == (0, count)


def test_words_and_pixels():
    assert spread_words(0.5) == (2**FRACTION // 2) ** 2
    assert spread_words(0.3) == round((0.3 * 2**FRACTION) ** 2)
    np.testing.assert_allclose(spread_px(np.array([0, 1, spread_words(2.0)])), [0, 2.0**-FRACTION, 2.0])


def test_refused():
    with pytest.raises(ValueError, match="threshold -1: expected at least 0: skin at rest touches nothing"):
        DotSpread(GRID, -1, LIMIT)
    with pytest.raises(ValueError, match="another is at the same pixel"):
        DotSpread(np.concatenate([GRID, GRID[3:4]]), 0, LIMIT)
