"""Dots are followed to where they are, also beyond half their spacing; lost and doubled ones are told."""

import dots
import numpy as np
import pytest

from fastac.models.integer.dot_follower import FRACTION, guides_of

SIDE = 96


@pytest.fixture(scope="module")
def follower():
    return dots.follower(SIDE, SIDE)


def found_px(follower, frame):
    shift, seen = follower(follower.windows(frame))
    return shift / (1 << FRACTION), seen


def places_of(follower):
    return follower.rest / (1 << FRACTION)


def test_dots_at_rest_do_not_move(follower):
    shift, seen = found_px(follower, dots.frame(SIDE, SIDE, dots.places(SIDE, SIDE)))
    assert seen.all()
    assert not shift.any()
    assert len(follower.rest) == len(dots.places(SIDE, SIDE))


@pytest.mark.parametrize("push", [(7.5, 0), (-5, 6), (3, -7)])
def test_a_smooth_motion_beyond_half_the_spacing(follower, push):
    rest = dots.places(SIDE, SIDE)
    near = np.exp(-((rest - SIDE / 2) ** 2).sum(axis=-1, keepdims=True) / (2 * 20**2))
    true = near * push
    order = [np.argmin(np.linalg.norm(rest - place, axis=-1)) for place in places_of(follower)]
    shift, seen = found_px(follower, dots.frame(SIDE, SIDE, rest + true))
    error = np.linalg.norm(shift - true[order], axis=-1)
    assert np.linalg.norm(true, axis=-1).max() > dots.SPACING_PX / 2
    assert seen.all()
    assert error.max() < 0.15


def test_lost_and_doubled_dots_have_no_shift_and_the_others_keep_theirs(follower):
    rest = dots.places(SIDE, SIDE)
    lost, doubled = 30, 50
    push, other = np.array((2.0, 1.0)), np.array((-1.0, 1.0))
    moved = np.concatenate([np.delete(rest, lost, axis=0) + push, rest[doubled : doubled + 1] + other])
    shift, seen = found_px(follower, dots.frame(SIDE, SIDE, moved))
    order = [np.argmin(np.linalg.norm(places_of(follower) - rest[k], axis=-1)) for k in (lost, doubled)]
    assert sorted(np.flatnonzero(~seen)) == sorted(order)
    assert not shift[order].any()
    np.testing.assert_allclose(shift[seen], np.broadcast_to(push, shift[seen].shape), atol=0.15)


def test_no_shift_exceeds_the_bound(follower):
    rng = np.random.default_rng(1)
    free = dots.DotFollower(
        follower.windows,
        follower.rest,
        follower.guides,
        0 * follower.low + 1,
        0 * follower.high + (1 << 30),
        follower.reach,
    )
    frames = rng.integers(0, 256, (40, SIDE, SIDE, 4)).astype(np.uint8)
    frames[rng.random(frames.shape[:3]) < 0.97] = 255
    shift, _ = free(free.windows(frames))
    assert follower.bound / 2 < np.abs(shift).max() <= follower.bound < 1 << (follower.width - 1)


def test_many_frames_are_each_as_if_alone(follower):
    frames = np.random.default_rng(2).integers(0, 256, (2, 3, SIDE, SIDE, 4)).astype(np.uint8)
    shift, seen = follower(follower.windows(frames))
    for index in np.ndindex(2, 3):
        alone = follower(follower.windows(frames[index]))
        np.testing.assert_array_equal(shift[index], alone[0])
        np.testing.assert_array_equal(seen[index], alone[1])


def test_guides_are_near_earlier_and_across():
    places = np.array([(0, 0), (10, 0), (20, 0), (0, 10), (10, 10), (60, 10)], float)
    assert guides_of(places, 10).tolist() == [[6, 6], [0, 0], [1, 1], [0, 1], [1, 3], [6, 6]]


def test_a_place_without_darkness_is_refused():
    bright = np.full((SIDE, SIDE, 4), 200, np.uint8)
    with pytest.raises(ValueError, match=r"dot at \d+, \d+ px: the background is not dark there"):
        dots.at_rest(
            dots.follower(SIDE, SIDE).windows, bright, dots.places(SIDE, SIDE), spacing_px=10, reach=3
        )
