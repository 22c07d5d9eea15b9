"""Darkness and windows against loops over pixels; bounds that are reached; what is refused."""

import numpy as np
import pytest

from fastac.models.integer.dot_windows import DotWindows

CHANNELS = 3


def windows_of(half=1, *, loadable=False):
    rng = np.random.default_rng(half)
    return DotWindows(rng.integers(0, 255 * CHANNELS + 1, (3, 4)), CHANNELS, half, loadable)


def by_loops(windows, frame):
    """Darkness, and sum and moments of each window, by Python's integers."""
    height, width = windows.image
    dark = [
        [max(int(windows.threshold[v // 4, u // 4]) - sum(map(int, frame[v, u])), 0) for u in range(width)]
        for v in range(height)
    ]
    side, found = 2 * (2 * windows.half + 1), []
    for top in range(0, height - side + 1, 2):
        found.append([])
        for left in range(0, width - side + 1, 2):
            total = across = down = 0
            for v in range(side):
                for u in range(side):
                    value = dark[top + v][left + u]
                    total += value
                    across += value * (2 * u - side + 1)
                    down += value * (2 * v - side + 1)
            found[-1].append((total, across, down))
    return dark, found


@pytest.mark.parametrize("half", [1, 2])
def test_equal_loops_over_pixels(half):
    windows = windows_of(half)
    frames = np.random.default_rng(1).integers(0, 256, (3, *windows.image, CHANNELS)).astype(np.uint8)
    frames[1], frames[2] = 0, 255
    found = windows(frames)
    assert found.shape == (3, *windows.shape, 3)
    for k, frame in enumerate(frames):
        dark, expected = by_loops(windows, frame)
        assert windows.darkness(frame).tolist() == dark
        assert found[k].tolist() == [[list(window) for window in row] for row in expected]
    assert found[1, ..., 0].max() == windows.mass_bound


@pytest.mark.parametrize("loadable", [False, True])
def test_the_moments_bound_is_reached_and_holds(loadable):
    windows = windows_of(loadable=loadable)
    top = np.full(windows.threshold.shape, 765) if loadable else windows.threshold
    largest = np.kron(top, np.ones((4, 4), int))
    height, width = windows.image
    v, u = np.indices(windows.image)
    # Dark from some line on, or up to it: among these is each window with one side dark alone.
    cuts = [u >= k for k in range(width)] + [v >= k for k in range(height)]
    cuts += [~cut for cut in cuts]
    moments = np.abs([windows.of_darkness(np.where(cut, largest, 0))[..., 1:] for cut in cuts])
    assert moments.max() == windows.moment_bound
    masses = windows.of_darkness(largest)[..., 0]
    assert masses.max() == windows.mass_bound < 1 << windows.mass_width


def test_refused():
    with pytest.raises(ValueError, match="windows of 3 cells or more that fit"):
        DotWindows(np.ones((2, 4), int), 4, 2)
    with pytest.raises(ValueError, match="windows of 3 cells"):
        DotWindows(np.ones((4, 4), int), 4, 0)
    with pytest.raises(ValueError, match="threshold 1 to 1021: expected 0 to 1020"):
        DotWindows(np.array([[1, 1021]] * 2), 4, 1)
