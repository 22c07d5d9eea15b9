"""Compiled loops over dots and bridges against models/integer, on every value."""

from dataclasses import replace

import dots
import numpy as np
import pytest

from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.models.loops.dots import FollowedDots, bridge, dark_pixels

HEIGHT, WIDTH = 44, 52


def frames_of(channels: int) -> np.ndarray:
    """Dots at rest, moved, covered, smeared and doubled; random, dark, bright, and one bright pixel."""
    rest = dots.places(HEIGHT, WIDTH)
    rng = np.random.default_rng(1)
    streak = rest[4] + np.outer(np.arange(7), (1, 0))
    drawn = [
        rest,
        rest + np.array((3.3, -2.1)),
        rest + rng.normal(scale=2, size=rest.shape),
        np.delete(rest, 4, axis=0),
        np.concatenate([rest, streak]),
        np.concatenate([rest, rest[4:5] + 2]),
    ]
    known = [dots.frame(HEIGHT, WIDTH, places, channels) for places in drawn]
    lit = 0 * known[0]
    lit[HEIGHT // 2, WIDTH // 2] = 255
    random = rng.integers(0, 256, (4, *lit.shape)).astype(np.uint8)
    return np.stack([*known, lit, 0 * lit, 0 * lit + 255, *random])


@pytest.mark.parametrize("thresholds", ["even", "random"])
@pytest.mark.parametrize(("half", "reach", "channels"), [(1, 3, 4), (2, 1, 3)])
def test_followed_dots_are_the_integers_dots(half, reach, channels, thresholds):
    follower = dots.follower(HEIGHT, WIDTH, half=half, reach=reach, channels=channels)
    if thresholds == "random":
        known = follower.windows.threshold
        threshold = np.random.default_rng(2).integers(0, 255 * channels + 1, known.shape)
        follower = replace(follower, windows=replace(follower.windows, threshold=threshold))
    images = frames_of(channels)
    shift, seen = follower(follower.windows(images))
    found = FollowedDots(follower)  # one for all frames, so that none leaves anything to the next
    for k, frame in enumerate(images):
        one_shift, one_seen = found(frame)
        np.testing.assert_array_equal(one_shift, shift[k], err_msg=f"frame {k}")
        np.testing.assert_array_equal(one_seen, seen[k], err_msg=f"frame {k}")
    assert seen.any()
    assert not seen.all()
    assert (shift < 0).any()
    if thresholds == "even":
        assert not shift[0].any()
        assert seen[:2].all()
        assert not seen[3:6].all(axis=1).any(), "a covered, a smeared and a doubled dot are each lost"


@pytest.mark.parametrize("reach", [1, 2, 5])
def test_bridged_slopes_are_the_integers_slopes(reach):
    rng = np.random.default_rng(reach)
    windows = DotWindows(rng.integers(0, 766, (HEIGHT // 4, WIDTH // 4)), 3, 1)
    known = SlopeBridge(windows, reach)
    for frame in frames_of(3):
        slopes, over = rng.integers(-511, 512, (HEIGHT, WIDTH, 2)), rng.random((HEIGHT, WIDTH, 2)) < 0.2
        dark = np.empty((HEIGHT, WIDTH), bool)
        for first in range(0, HEIGHT, 3):
            dark_pixels(frame, windows.threshold, first, dark[first : first + 3])
        np.testing.assert_array_equal(dark, known.dark(frame))
        for kind, count in ((np.float64, 2), (np.float32, 0)):
            planes = np.moveaxis(slopes, -1, 0).astype(kind).reshape(2, -1)
            flags = np.ascontiguousarray(np.moveaxis(over, -1, 0).reshape(2, -1)[:, : HEIGHT * WIDTH * count])
            saturated = bridge(dark, reach, planes[0], planes[1], flags)
            np.testing.assert_array_equal(planes.T.reshape(HEIGHT, WIDTH, 2), known(slopes, dark))
            assert saturated == (known(over, dark).sum() if count else 0)
