"""The spread of the touching dots: by its definition, at its bounds, and of rigid motions."""

import numpy as np
import pytest
from dots import follower

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.dot_spread import LEAST_DOTS, DotSpread, spread_px, spread_words
from fastac.models.vision.rigid_spread import rigid_spread_px

SIDE = 48
FOLLOWER = follower(SIDE, SIDE)
SPREAD = DotSpread.of_follower(FOLLOWER, 20)
COUNT, LIMIT = len(SPREAD.place), SPREAD.shift_limit
PRESSED = np.full((SIDE - 2, SIDE - 2), 100)


def sums(contact: np.ndarray, shift: np.ndarray) -> dict[str, int]:
    """What `DotSpread.bounds` bounds, of one frame."""
    u, v = (column.tolist() for column in shift[contact].T)
    x, y = (column.tolist() for column in SPREAD.xy[contact].T)
    found = {
        "n": len(u),
        "u": sum(u),
        "v": sum(v),
        "x": sum(x),
        "y": sum(y),
        "square": sum(a * a + b * b for a, b in zip(u, v, strict=True)),
        "turn": sum(c * b - d * a for a, b, c, d in zip(u, v, x, y, strict=True)),
        "far": sum(c * c + d * d for c, d in zip(x, y, strict=True)),
    }
    n = found["n"]
    found["A"] = n * found["square"] - found["u"] ** 2 - found["v"] ** 2
    found["B"] = n * found["turn"] - found["x"] * found["v"] + found["y"] * found["u"]
    found["C"] = n * found["far"] - found["x"] ** 2 - found["y"] ** 2
    return found


def at_the_limits() -> np.ndarray:
    """Shifts that reach for the bounds: all alike, away from the middle, about it, and in turns."""
    alike = np.ones((COUNT, 2), np.int64)
    outwards = np.where(SPREAD.xy < 0, -1, 1)
    around = outwards[:, ::-1] * [-1, 1]
    turns = np.where(np.arange(COUNT) % 2, 1, -1)[:, None] * alike
    return LIMIT * np.stack([alike, -alike, outwards, around, -around, turns])


def test_it_is_the_mean_square_about_the_best_rigid_motion():
    rng = np.random.default_rng(1)
    shift = rng.integers(-LIMIT, LIMIT + 1, (50, COUNT, 2))
    shift[1::2] //= 20
    seen = rng.random((50, COUNT)) < 0.6
    found, dots = SPREAD(shift, seen, np.broadcast_to(PRESSED, (50, *PRESSED.shape)))
    assert dots.tolist() == seen.sum(axis=1).tolist()
    for words, moved, chosen in zip(found, shift, seen, strict=True):
        exact = (rigid_spread_px(SPREAD.place[chosen], moved[chosen] * 2.0**-FRACTION) * 2**FRACTION) ** 2
        assert words == np.floor(exact * (1 + 1e-12))
    assert found[0] > 0


def test_rigid_motions_have_no_spread():
    seen = np.ones(COUNT, bool)
    for shift in ([LIMIT, -LIMIT], [0, 0], [3, 1]):
        assert SPREAD(np.tile(shift, (COUNT, 1)), seen, PRESSED) == (0, COUNT)
    x, y = SPREAD.xy.T
    turned = np.stack([-7 * y + 5, 7 * x - 9], axis=-1)
    assert SPREAD(turned, seen, PRESSED) == (0, COUNT)
    stretched = np.stack([7 * x, 7 * y], axis=-1)
    assert SPREAD(stretched, seen, PRESSED)[0] > 0, "a stretch is no rigid motion"


def test_contact_is_displacement_beyond_the_threshold_at_a_dot_that_is_seen():
    displacement = np.zeros_like(PRESSED)
    values = [20, 21, 100, 100, -100]
    for (column, row), value in zip(SPREAD.place, values, strict=False):
        displacement[row, column] = value
    seen = np.ones(COUNT, bool)
    seen[3] = False
    expected = [False, True, True, False, False, *[False] * (COUNT - 5)]
    assert SPREAD.contact(displacement, seen).tolist() == expected


def test_fewer_than_three_dots_have_no_spread():
    shift = np.arange(2 * COUNT).reshape(COUNT, 2) ** 2 % 23
    for count in range(LEAST_DOTS + 1):
        seen = np.arange(COUNT) < count
        spread, dots = SPREAD(shift, seen, PRESSED)
        assert dots == count
        assert (spread > 0) == (count >= LEAST_DOTS)


def test_bounds_hold_and_are_reached():
    """Of each sum the bound is reached, of A, B and C more than a fifth of it."""
    rng = np.random.default_rng(2)
    contacts = [np.ones(COUNT, bool), *(rng.random((20, COUNT)) < rng.random((20, 1)))]
    contacts += [sign * SPREAD.xy[:, axis] > 0 for axis in (0, 1) for sign in (1, -1)]
    reached = dict.fromkeys(SPREAD.bounds, 0)
    for contact in contacts:
        for shift in at_the_limits():
            for name, value in sums(contact, shift).items():
                reached[name] = max(reached[name], abs(value))
            reached["spread"] = max(reached["spread"], int(SPREAD(shift, contact, PRESSED)[0]))
    for name, bound in SPREAD.bounds.items():
        least = 0.2 * bound if name in "ABC" else 0.9 * bound
        assert least <= reached[name] <= bound, name


def test_a_dot_on_the_rim_is_looked_up_beside_it():
    placed = DotSpread.of_follower(FOLLOWER, 0).place
    assert (placed == FOLLOWER.rest_px - 1).all()
    moved = FOLLOWER.rest.copy()
    moved[0], moved[-1] = 0, (SIDE - 1) << FRACTION
    known = type("Rim", (), {"rest_px": moved >> FRACTION, "windows": FOLLOWER.windows, "bound": LIMIT})
    assert DotSpread.of_follower(known, 0).place[[0, -1]].tolist() == [[0, 0], [SIDE - 3, SIDE - 3]]


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="threshold -1: expected at least 0"):
        DotSpread(SPREAD.place, -1, LIMIT)
    with pytest.raises(ValueError, match="two dots at one pixel"):
        DotSpread(SPREAD.place[[0, 1, 0]], 0, LIMIT)


def test_words_are_squares_of_64ths_of_a_pixel():
    assert spread_words(1.0) == 4096
    assert spread_px(np.array([4096, 0, 1024])).tolist() == [1, 0, 0.5]
