# amaranth: UnusedElaboratable=no
"""Slip finds the spread of dots whose places were loaded after it was built."""

from dataclasses import replace

import dots
import numpy as np
import pytest
from amaranth import signed

from fastac.gateware.calibration import CalibrationError, calibration_words
from fastac.gateware.dot_slip import DotSlip
from fastac.gateware.dots.follower import dot_layout
from fastac.gateware.slip.spread_ratio import spread_layout
from fastac.models.integer.dot_spread import LEAST_DOTS, DotSpread
from fastac.models.random_bundle import random_bundle, recalibrated, scene
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import pack

FRAMES = 12
WANTED = {"solver": "tridiagonal", "kernel": "collapsed", "dots": True, "clamp": False, "size": 24}


@pytest.fixture(scope="module")
def bundles(tmp_path_factory):
    """Of hardware with slip, and of another gel on it."""
    folder = tmp_path_factory.mktemp("bundles")
    own = random_bundle(folder / "own", scene(("force_z", "slip"), lanes=2, **WANTED))
    return own, recalibrated(folder / "other", own)


def component(pipeline, *, rows_reversed=True) -> DotSlip:
    word = signed(pipeline.quantiser.bits)
    return DotSlip(pipeline, word, lanes=2, rows_reversed=rows_reversed)


@pytest.mark.parametrize("rows_reversed", [False, True])
def test_loaded_places(bundles, rows_reversed):
    own, other = (bundle.pipeline for bundle in bundles)
    rng, spread = np.random.default_rng(1), other.spread
    top, side = other.quantiser.top, other.scene.inner_px
    shifts = rng.integers(-spread.shift_limit, spread.shift_limit + 1, (FRAMES, 9, 2))
    seen = rng.random((FRAMES, 9)) < 0.8
    displacement = rng.integers(-top, top + 1, (FRAMES, side, side))
    displacement[0] = top
    expected, count = spread(shifts, seen, displacement)
    assert len(set(count.tolist())) > LEAST_DOTS
    assert (own.spread(shifts, seen, displacement)[0] != expected).any()
    dut = component(own, rows_reversed=rows_reversed)
    tables = component(other, rows_reversed=rows_reversed).tables
    assert {name: t.format for name, t in tables.items()} == {n: t.format for n, t in dut.tables.items()}
    rows = displacement[:, ::-1] if rows_reversed else displacement
    inputs = {
        "dots": dots.shift_payloads(other.follower, shifts, seen),
        "displacement": pack(rows.reshape(-1, 2), other.quantiser.bits),
    }
    for stall in (0, 0.4):
        found, _ = run_streams(
            dut,
            inputs,
            {"o": FRAMES},
            tables={name: pack(table.values, table.format.bits) for name, table in tables.items()},
            stall=stall,
        )
        layout = spread_layout(spread)
        words = [dots.packed(layout, pair) for pair in zip(expected, count, strict=True)]
        assert found["o"] == words


def test_words_hold_places_anywhere(bundles):
    """Bounds are those of any places: of dots in the corners, and of all dots at the largest distances."""
    own = bundles[0].pipeline
    side = own.scene.inner_px
    corners = np.array([(0, 0), (side - 1, 0), (0, side - 1), (side - 1, side - 1)])
    places = np.concatenate([corners, np.stack([np.arange(1, 6), 0 * np.arange(5)], axis=1)])
    assert len(places) == len(own.spread.place)
    for place in (places, places[::-1], side - 1 - places):
        spread = replace(own.spread, place=place)
        fixed = DotSpread(place, spread.threshold, spread.shift_limit)
        assert spread.bounds == own.spread.bounds
        assert all(fixed.bounds[name] <= spread.bounds[name] for name in fixed.bounds)
        assert all(a <= b for a, b in zip(fixed.largest, spread.largest, strict=True))
    assert dot_layout(own.follower).size == 2 * own.follower.width + 1


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ({3: (7, 13.2), 4: (8, 13.3)}, "dot at 7, 13 px: another is in the same beat of 2 pixels"),
        ({3: (7.2, 12.6), 4: (6.9, 13.4)}, "dot at 7, 13 px: another is at the same pixel"),
    ],
)
def test_places_that_slip_cannot_tell_apart_are_refused(bundles, places, message):
    own, other = bundles
    follower = other.pipeline.follower
    rest = follower.rest.copy()
    for dot, place in places.items():
        rest[dot] = np.rint(np.array(place) * 64)
    new = replace(other, pipeline=other.pipeline.replace(follower=replace(follower, rest=rest)))
    with pytest.raises(CalibrationError) as refusal:
        calibration_words(new, own)
    assert str(refusal.value) == message
