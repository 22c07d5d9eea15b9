# amaranth: UnusedElaboratable=no
"""Slopes meet the darkness of their own pixels, however much earlier that comes."""

import numpy as np
import pytest

from fastac.gateware.bridged_slopes import BridgedSlopes
from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import pack

BITS, LANES, AHEAD = 8, 2, 5


@pytest.fixture
def known():
    rng = np.random.default_rng(1)
    bridge = SlopeBridge(DotWindows(np.full((2, 4), 100), 4, 1), 3)
    darkness = np.where(rng.random((3, 8, 16)) < 0.5, rng.integers(0, 101, (3, 8, 16)), 0)
    slopes = rng.integers(-100, 101, (3, 8, 16, 2))
    expected = pack(bridge(slopes, darkness > 0).reshape(-1, 2 * LANES), BITS)
    streams = {
        "darkness": pack(darkness.reshape(-1, LANES), bridge.windows.darkness_width),
        "slopes": pack(slopes.reshape(-1, 2 * LANES), BITS),
    }
    return BridgedSlopes(bridge, slope_bits=BITS, lanes=LANES, ahead=AHEAD), streams, expected


@pytest.mark.parametrize(("darkness", "slopes"), [(0, 4), (0, 40), (9, 0)])
def test_bit_exact_whenever_the_darkness_comes(known, darkness, slopes):
    dut, streams, expected = known
    start = {"darkness": darkness, "slopes": slopes}
    found, taken = run_streams(dut, streams, {"o": len(expected)}, start=start)
    assert found["o"] == expected
    assert np.diff(taken["slopes"]).max() == 1, "no pause"
    waited = taken["darkness"][AHEAD] - taken["darkness"][AHEAD - 1]
    assert (waited > 1) == (slopes == 40), "only what is kept can be ahead"
    if darkness == 0:
        assert taken["o"][0] - taken["slopes"][0] == dut.latency


def test_bit_exact_with_pauses(known):
    dut, streams, expected = known
    found, _ = run_streams(dut, streams, {"o": len(expected)}, stall=0.4)
    assert found["o"] == expected
