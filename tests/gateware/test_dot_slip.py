# amaranth: UnusedElaboratable=no
"""Slip from dots and displacement equals the integers, frame after frame, whichever comes first."""

from types import SimpleNamespace

import numpy as np
import pytest
from amaranth import signed
from dots import follower, packed, shift_payloads
from slip import BITS, THRESHOLD, displacement_beats, situations

from fastac.gateware.dot_slip import DotSlip
from fastac.gateware.slip.spread_ratio import spread_layout
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

SIDE, FRAMES = 48, 8
FOLLOWER = follower(SIDE, SIDE)
SPREAD = DotSpread.of_follower(FOLLOWER, THRESHOLD)
PIPELINE = SimpleNamespace(spread=SPREAD, follower=FOLLOWER, scene=SimpleNamespace(inner_px=SIDE - 2))


@pytest.mark.parametrize("first", ["dots", "displacement"])
@pytest.mark.parametrize(("lanes", "rows_reversed", "stall"), [(1, False, 0), (2, True, 0.3), (4, True, 0)])
@pytest.mark.quick("1-False-0-dots", "4-True-0-displacement")
def test_bit_exact_whichever_comes_first(lanes, rows_reversed, stall, first):
    shift, seen, displacement = situations(FOLLOWER, SPREAD, FRAMES)
    dut = DotSlip(PIPELINE, signed(BITS), lanes=lanes, rows_reversed=rows_reversed)
    beats = displacement_beats(displacement, lanes, rows_reversed=rows_reversed)
    inputs = {"dots": shift_payloads(FOLLOWER, shift, seen), "displacement": beats}
    start = {"dots": 3000} if first == "displacement" else {}
    found, taken = run_streams(dut, inputs, {"o": FRAMES}, start=start, stall=stall)
    layout = spread_layout(SPREAD)
    expected = zip(*SPREAD(shift, seen, displacement), strict=True)
    assert found["o"] == [packed(layout, values) for values in expected]
    if not stall:
        last = max(taken["displacement"][len(beats) // FRAMES - 1], taken["dots"][len(SPREAD.place) - 1])
        assert taken["o"][0] - last == dut.latency
        assert np.diff(taken["o"]).min() >= dut.interval
    assert dut.multipliers == 4


def test_frames_back_to_back_wait_only_where_they_are_shorter_than_the_interval():
    shift, seen, displacement = situations(FOLLOWER, SPREAD, FRAMES)
    for lanes in (1, 4):
        dut = DotSlip(PIPELINE, signed(BITS), lanes=lanes, rows_reversed=False)
        beats = displacement_beats(displacement, lanes, rows_reversed=False)
        inputs = {"dots": shift_payloads(FOLLOWER, shift, seen), "displacement": beats}
        _, taken = run_streams(dut, inputs, {"o": FRAMES})
        assert len(beats) // FRAMES > dut.interval
        assert np.diff(taken["displacement"]).max() == 1
