"""Bridged slopes against the definition: the nearest skin of the row, of two as near the left one."""

import numpy as np
import pytest

from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge

WINDOWS = DotWindows(np.full((3, 5), 300), 3, 1)


def row(dark: str, reach: int) -> list[int]:
    """The columns whose values the pixels of one row take; `#` is dark."""
    mask = np.array([[mark == "#" for mark in dark]])
    return SlopeBridge(WINDOWS, reach).columns(mask)[0].tolist()


def by_definition(dark: list[bool], reach: int) -> list[int]:
    skin = [u for u, value in enumerate(dark) if not value]
    found = []
    for u, value in enumerate(dark):
        near = [(abs(u - other), other) for other in skin if abs(u - other) <= reach]
        found.append(min(near)[1] if value and near else u)
    return found


@pytest.mark.parametrize("reach", [1, 2, 5, 30])
def test_equals_the_definition(reach):
    rng = np.random.default_rng(reach)
    dark = rng.random((3, 40, 21)) < np.array([0.3, 0.6, 0.9])[:, None, None]
    found = SlopeBridge(WINDOWS, reach).columns(dark)
    expected = [[by_definition(line, reach) for line in frame] for frame in dark.tolist()]
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("dark", "reach", "columns"),
    [
        (".....", 3, [0, 1, 2, 3, 4]),
        ("#####", 3, [0, 1, 2, 3, 4]),
        (".###.", 2, [0, 0, 0, 4, 4]),  # the middle one is as near to both
        (".####.", 2, [0, 0, 0, 5, 5, 5]),
        (".#####.", 2, [0, 0, 0, 3, 6, 6, 6]),  # wider than twice the reach
        ("##..#", 2, [2, 2, 2, 3, 3]),  # only one side at a row's ends
        ("###..", 2, [0, 3, 3, 3, 4]),
        ("..###", 2, [0, 1, 1, 1, 4]),
    ],
)
def test_ties_gaps_and_the_ends_of_rows(dark, reach, columns):
    assert row(dark, reach) == columns


def test_values_of_dark_pixels_are_those_of_the_skin_beside_them():
    rng = np.random.default_rng(1)
    dark, values = rng.random((2, 12, 20)) < 0.5, rng.integers(-99, 100, (2, 12, 20, 2))
    bridge = SlopeBridge(WINDOWS, 2)
    found, columns = bridge(values, dark), bridge.columns(dark)
    for f, v, u in np.ndindex(dark.shape):
        assert found[f, v, u].tolist() == values[f, v, columns[f, v, u]].tolist()
    np.testing.assert_array_equal(found[~dark], values[~dark])
    assert (found != values).any()


def test_a_slope_that_changes_evenly_loses_nothing_in_its_sum():
    slope = np.arange(20)[None, :, None] * 3
    for first, width in ((5, 4), (8, 6), (1, 2)):
        dark = np.zeros((1, 20), bool)
        dark[:, first : first + width] = True
        found = SlopeBridge(WINDOWS, 3)(slope, dark)
        assert found.sum() == slope.sum()
        assert (found != slope).any()


def test_dark_is_what_is_darker_than_the_threshold():
    """Each channel counts, and each block has its own threshold."""
    threshold = np.arange(15).reshape(3, 5) * 40
    bridge = SlopeBridge(DotWindows(threshold, 3, 1), 2)
    frame = np.zeros((12, 20, 3), np.uint8)
    assert bridge.dark(frame).sum() == 14 * 16
    frame[..., 1] = 40
    found = bridge.dark(frame)
    assert not found[:4, :8].any(), "a pixel as bright as its threshold is skin"
    assert found[:4, 8:].all()
    assert found[4:].all()
    np.testing.assert_array_equal(bridge.dark(frame[None])[0], found)


def test_refused():
    with pytest.raises(ValueError, match="reach 0: expected at least 1"):
        SlopeBridge(WINDOWS, 0)
