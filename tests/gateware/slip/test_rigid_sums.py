# amaranth: UnusedElaboratable=no
"""Sums over the dots that touch: all values to their bounds, dots or contact first, in the clocks stated."""

import dots
import numpy as np
import pytest
import slips

from fastac.gateware.slip.rigid_sums import KEPT_FRAMES, RigidSums
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

FOLLOWER = dots.follower(24, 28)
SPREAD = DotSpread.of_follower(FOLLOWER, 3)
COUNT = len(FOLLOWER.rest)
ORDER = np.random.default_rng(5).permutation(COUNT)
"""In which the dots' contacts come; any is possible."""


def component() -> RigidSums:
    return RigidSums(SPREAD, FOLLOWER, ORDER)


def cases(count: int):
    """Payloads of dots and of contacts, and of the sums: a dot that is not seen has no part in them."""
    shifts, contact = slips.frames(SPREAD, count)
    seen = np.random.default_rng(2).random(contact.shape) < 0.8
    seen[: len(contact) - count] = True  # of the extremes
    given = {
        "dots": dots.shift_payloads(FOLLOWER, shifts, seen),
        "contact": slips.contact_payloads(contact, ORDER),
    }
    return given, slips.sum_payloads(SPREAD, shifts, contact & seen)


def test_extremes_reach_every_bound():
    """So that in the tests below no register is wider than it has to be."""
    found = [slips.sums(SPREAD, *frame) for frame in zip(*slips.extremes(SPREAD), strict=True)]
    for name in ("n", "u", "v", "x", "y", "square", "turn", "far"):
        values = [sums[name] for sums in found]
        assert max(map(abs, values)) == SPREAD.bounds[name], name
        if name in ("u", "v", "turn"):
            assert min(values) == -max(values), name


def test_values_and_interval():
    """Dots are there before each contact: contacts and sums follow each other at the interval."""
    dut, (given, expected) = component(), cases(20)
    found, taken = run_streams(dut, given, {"o": len(expected)}, start={"contact": 2 * COUNT})
    assert found["o"] == expected
    assert (np.subtract(taken["o"], taken["contact"]) == dut.latency).all()
    assert set(np.diff(taken["contact"])) == {dut.interval}


def test_dots_last():
    dut, (given, expected) = component(), cases(4)
    found, taken = run_streams(dut, given, {"o": len(expected)}, start={"dots": 40})
    assert found["o"] == expected
    assert taken["o"][0] - taken["dots"][COUNT - 1] == dut.latency + 1


@pytest.mark.parametrize("stall", [0.3, 0.7])
def test_pauses(stall):
    given, expected = cases(12)
    found, _ = run_streams(component(), given, {"o": len(expected)}, stall=stall)
    assert found["o"] == expected


def test_a_slow_reader():
    """Sums stay as they are while they wait, and no frame's dots are overwritten."""
    given, expected = cases(12)
    stall = {"dots": 0, "contact": 0, "o": 0.97}
    found, _ = run_streams(component(), given, {"o": len(expected)}, stall=stall)
    assert found["o"] == expected


def test_dots_of_a_few_frames_are_kept():
    late, (given, expected) = 2 * KEPT_FRAMES * COUNT, cases(4)
    found, taken = run_streams(component(), given, {"o": len(expected)}, start={"contact": late})
    assert found["o"] == expected
    early = [clock for clock in taken["dots"] if clock < late]
    assert early == list(range(KEPT_FRAMES * COUNT)), "none waits before, and none is taken after"


@pytest.mark.parametrize("count", [1, 2])
def test_a_sensor_of_very_few_dots(count):
    """Frame by frame the right bank of the memory is read."""
    follower = dots.follower(16, 8 * count + 8)
    assert len(follower.rest) == count
    spread = DotSpread.of_follower(follower, 3)
    rng = np.random.default_rng(3)
    shifts = rng.integers(-9, 10, (12, count, 2))
    contact, seen = rng.random((2, 12, count)) < 0.7
    order = np.arange(count)
    given = {
        "dots": dots.shift_payloads(follower, shifts, seen),
        "contact": slips.contact_payloads(contact, order),
    }
    expected = slips.sum_payloads(spread, shifts, contact & seen)
    dut = RigidSums(spread, follower, order)
    found, _ = run_streams(dut, given, {"o": len(expected)}, start={"contact": 9 * count})
    assert found["o"] == expected
