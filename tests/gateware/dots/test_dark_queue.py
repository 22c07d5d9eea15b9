# amaranth: UnusedElaboratable=no
"""Dark pixels leave the queue as they entered, a clock later, and as many wait as it has places."""

import numpy as np
import pytest

from fastac.gateware.dots.dark_queue import DarkQueue
from fastac.models.integer.dot_windows import DotWindows
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack

WINDOWS = DotWindows(np.array([[700, 3], [0, 1020]]), 4, 1)


def beats(lanes):
    """Darkness of pixels: none, all of any bit, each bit alone, each pixel alone, and at random."""
    rng = np.random.default_rng(lanes)
    width, darkest = WINDOWS.darkness_width, WINDOWS.darkest
    alone = 1 << np.arange(width)
    values = np.concatenate([[0, 1, darkest, 0], alone, 0 * alone])
    same = np.repeat(values[:, None], lanes, axis=1)
    single = np.concatenate([bit * np.eye(lanes, dtype=int) for bit in alone])
    at_random = rng.integers(0, darkest + 1, (40, lanes)) * (rng.random((40, lanes)) < 0.5)
    return np.concatenate([same, single, at_random])


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.quick("4")
def test_which_pixels_are_dark(tmp_path, lanes):
    darkness = beats(lanes)
    dut = DarkQueue(WINDOWS, lanes=lanes, depth=5)
    assert dut.latency == 1
    check(
        dut,
        "dark_queue",
        tmp_path,
        inputs=pack(darkness, WINDOWS.darkness_width),
        expected=pack(darkness > 0, 1),
        latencies=[(k, k, dut.latency) for k in range(len(darkness))],
    )


@pytest.mark.parametrize("depth", [1, 2, 7])
def test_as_many_wait_as_there_are_places(depth):
    darkness = beats(2)
    dut = DarkQueue(WINDOWS, lanes=2, depth=depth)
    inputs, expected = pack(darkness, WINDOWS.darkness_width), pack(darkness > 0, 1)
    payloads, taken = run_streams(dut, inputs, {"o": len(expected)}, stall={"i": 0, "o": 0.98})
    assert payloads["o"] == expected
    waiting = [sum(t < clock for t in taken["i"]) - k for k, clock in enumerate(taken["o"])]
    assert max(waiting) == depth
