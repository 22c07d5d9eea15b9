"""Layers follow the streams, nothing overlaps, and chains are straight."""

from itertools import pairwise

import pytest

from fastac_docs.layout import place, ranks

EDGES = [("a", "b"), ("b", "c"), ("a", "d"), ("d", "e"), ("c", "e"), ("a", "e"), ("e", "f"), ("e", "g")]
WIDTHS = dict.fromkeys("abcdefg", 100.0)


@pytest.fixture(scope="module")
def layout():
    return place(WIDTHS, EDGES, gap=20, lane=30)


def test_every_block_is_below_what_it_comes_from():
    found = ranks(list(WIDTHS), EDGES)
    assert found == {"a": 0, "b": 1, "d": 1, "c": 2, "e": 3, "f": 4, "g": 4}


def test_a_circle_is_an_error():
    with pytest.raises(ValueError, match="streams in a circle: a, b"):
        ranks(["a", "b"], [("a", "b"), ("b", "a")])


def test_nothing_overlaps(layout):
    for layer in layout.layers:
        for one, other in pairwise(layer):
            wide = [WIDTHS.get(name, 30) if isinstance(name, str) else 30 for name in (one, other)]
            assert layout.centre[other] - layout.centre[one] >= sum(wide) / 2 + 20 - 1e-3
    assert min(layout.centre[name] - WIDTHS[name] / 2 for name in WIDTHS) >= -1e-6


def test_long_streams_have_a_place_in_each_layer_that_they_pass(layout):
    assert layout.ways["a", "e"] == ["a", ("a", "e", 1), ("a", "e", 2), "e"]
    assert ("a", "e", 1) in layout.layers[1]


def test_chains_are_straight():
    found = place({"a": 10, "b": 80, "c": 10, "d": 40}, [("a", "b"), ("b", "c"), ("c", "d")], gap=9, lane=9)
    assert max(found.centre.values()) - min(found.centre.values()) < 0.1


def test_a_fork_does_not_cross():
    edges = [("a", "left"), ("a", "right"), ("left", "x"), ("right", "y")]
    found = place(dict.fromkeys(["a", "right", "left", "y", "x"], 50.0), edges, gap=9, lane=9)
    assert (found.centre["left"] < found.centre["right"]) == (found.centre["x"] < found.centre["y"])
