# amaranth: UnusedElaboratable=no
"""From shifts and displacements to the spread: bit-exact, whichever comes first, at the camera's rate."""

from types import SimpleNamespace

import dots
import numpy as np
import pytest
import slips
from amaranth import signed

from fastac.gateware.dot_slip import DotSlip
from fastac.gateware.slip.rigid_sums import KEPT_FRAMES
from fastac.gateware.slip.spread_ratio import spread_layout
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

SIDE, BITS, THRESHOLD = 36, 6, 5
ROWS = SIDE - 2
FOLLOWER = dots.follower(SIDE, SIDE)
COUNT = len(FOLLOWER.rest)


def component(lanes: int = 1, *, rows_reversed: bool = False, rows: int = ROWS, spread=None) -> DotSlip:
    """With what it uses of a pipeline."""
    pipeline = SimpleNamespace(
        spread=DotSpread.of_follower(FOLLOWER, THRESHOLD) if spread is None else spread,
        follower=FOLLOWER,
        scene=SimpleNamespace(inner_px=rows),
    )
    return DotSlip(pipeline, signed(BITS), lanes=lanes, rows_reversed=rows_reversed)


def cases(dut: DotSlip, count: int, *, rows_reversed: bool = False):
    """Payloads of shifts and displacements, and of the spreads; dots are lost too."""
    spread, rows, rng = dut.pipeline.spread, dut.contact.rows, np.random.default_rng(1)
    shifts, contact = slips.frames(spread, 20)
    drawn = rng.permutation(len(shifts))[:count]
    shifts, contact = shifts[drawn], contact[drawn]
    seen = rng.random(contact.shape) < 0.9
    displacement = rng.integers(-1 << BITS - 1, 1 << BITS - 1, (count, rows, rows))
    column, row = spread.place.T
    displacement[:, row, column] = np.where(contact, THRESHOLD + 1, THRESHOLD)
    found, touching = spread(shifts, seen, displacement)
    assert len(np.unique(found)) > count // 2
    assert (touching < contact.sum(axis=1)).any(), "some that touch are not seen"
    given = {
        "dots": dots.shift_payloads(FOLLOWER, shifts, seen),
        "displacement": slips.displacement_payloads(
            displacement, BITS, dut.contact.lanes, rows_reversed=rows_reversed
        ),
    }
    layout = spread_layout(spread)
    return given, [dots.packed(layout, values) for values in zip(found, touching, strict=True)]


@pytest.mark.parametrize(("lanes", "rows_reversed"), [(1, False), (2, True), (4, True), (4, False)])
def test_camera_rate(lanes, rows_reversed):
    """Neither input waits; the spread comes `latency` clocks after the frame's last displacements."""
    dut = component(lanes, rows_reversed=rows_reversed)
    given, expected = cases(dut, 10, rows_reversed=rows_reversed)
    beats = dut.contact.row_beats * ROWS
    assert beats >= dut.interval
    found, taken = run_streams(dut, given, {"o": len(expected)})
    assert found["o"] == expected
    assert taken["displacement"] == list(range(len(given["displacement"])))
    last = taken["displacement"][beats - 1 :: beats]
    assert taken["o"] == [clock + dut.latency for clock in last]


def test_dots_last():
    dut = component(4)
    given, expected = cases(dut, 4)
    late = dut.contact.row_beats * ROWS + 20
    found, taken = run_streams(dut, given, {"o": len(expected)}, start={"dots": late})
    assert found["o"] == expected
    assert taken["o"][0] - taken["dots"][COUNT - 1] == dut.latency


def test_dots_of_a_few_frames_may_come_first():
    dut = component(4)
    given, expected = cases(dut, KEPT_FRAMES + 2)
    late = (KEPT_FRAMES + 2) * COUNT
    found, taken = run_streams(dut, given, {"o": len(expected)}, start={"displacement": late})
    assert found["o"] == expected
    assert taken["dots"][: KEPT_FRAMES * COUNT] == list(range(KEPT_FRAMES * COUNT))


def test_frames_that_come_faster_leave_at_the_interval():
    """On an image so small that its pixels take less time than the ratio."""
    place = np.array([(k % 3, k // 3) for k in range(COUNT)])
    spread = DotSpread(place, THRESHOLD, FOLLOWER.bound)
    dut = component(1, rows=3, spread=spread)
    given, expected = cases(dut, 10)
    assert len(given["displacement"]) // len(expected) < dut.interval
    found, taken = run_streams(dut, given, {"o": len(expected)})
    assert found["o"] == expected
    assert set(np.diff(taken["o"])) == {dut.interval}


@pytest.mark.parametrize("stall", [0.4, 0.9])
def test_pauses(stall):
    dut = component(4, rows_reversed=True)
    given, expected = cases(dut, 8, rows_reversed=True)
    stalls = {"dots": 0.4, "displacement": 0.4, "o": stall}
    found, _ = run_streams(dut, given, {"o": len(expected)}, stall=stalls)
    assert found["o"] == expected


def test_multipliers():
    assert component().multipliers == 4
