import numpy as np
import pytest

from fastac.models.integer.light_level import (
    SHIFT_LIMIT,
    followed,
    levelled,
    lit,
    settled_shift,
    shifted,
)


@pytest.fixture
def background():
    found = np.random.default_rng(1).integers(40, 200, (9, 8, 3)).astype(np.uint8)
    found[:, :2] = 0  # outside the image
    found[2, 3] = 255
    return found


def drifted(background, drift, contact=0.3, seed=2):
    """The background with a drift of each channel and noise, a part of it in contact."""
    rng = np.random.default_rng(seed)
    frame = background + np.array(drift) * lit(background) + rng.integers(-2, 3, background.shape)
    touched = rng.random(background.shape) < contact
    return np.clip(np.where(touched, 255, frame), 0, 255).astype(np.uint8)


def test_the_shift_is_the_median_of_lit_values(background):
    frame = drifted(background, (9, -7, 0))
    seen = lit(background)
    seen[-1] = False
    for channel, shift in enumerate(settled_shift(frame[None], background)[0]):
        difference = np.where(frame == 255, 255, frame - background.astype(int))
        values = np.sort(difference[..., channel][seen[..., channel]])
        low, high = values[(len(values) - 1) // 2], values[len(values) // 2]
        assert shift == np.clip(0, low, high)


def test_levelled_frames_keep_their_dark_values_and_stay_as_they_are(background):
    frames = np.stack([drifted(background, drift) for drift in ((9, -7, 0), (0, 0, 0), (-30, 50, 3))])
    once = levelled(frames, background)
    assert (once[:, :, :2] == frames[:, :, :2]).all()
    assert not settled_shift(once, background).any()
    np.testing.assert_array_equal(levelled(once, background), once)


@pytest.mark.parametrize("drift", [(5, -4, 0), (100, -100, 1)])
def test_the_hardware_s_shift_comes_to_rest_at_the_settled_one(background, drift):
    frame = drifted(background, drift, contact=0.2)
    shifts = [np.zeros(3, np.int64)]
    for _ in range(SHIFT_LIMIT + 2):
        seen, following = followed(frame[None], background, shifts[-1])
        shifts.append(following)
    assert np.abs(np.diff(shifts, axis=0)).max() == 1
    np.testing.assert_array_equal(shifts[-1], settled_shift(frame[None], background)[0])
    np.testing.assert_array_equal(seen, levelled(frame[None], background))


def test_extremes():
    """Nothing lit, everything saturated, and shifts that leave the range of a byte."""
    dark = np.zeros((4, 4, 3), np.uint8)
    assert not settled_shift(np.full((1, 4, 4, 3), 255, np.uint8), dark).any()
    bright = np.full((4, 4, 3), 254, np.uint8)
    black = np.zeros((1, 4, 4, 3), np.uint8)
    assert (settled_shift(black, bright) == -SHIFT_LIMIT).all()
    assert (shifted(black + 9, bright, np.full((1, 3), SHIFT_LIMIT)) == 0).all()
    assert (shifted(black + 249, bright, np.full((1, 3), -SHIFT_LIMIT)) == 255).all()
    clipped = np.stack([black[0], black[0] + 255])
    np.testing.assert_array_equal(shifted(clipped, bright, np.full((2, 3), 5)), clipped)
