# amaranth: UnusedElaboratable=no
"""Bridged slopes equal their integers for all lanes and reaches; a frame's last row needs no further one."""

import numpy as np
import pytest

from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.models.integer.dot_windows import DotWindows
from fastac.models.integer.slope_bridge import SlopeBridge
from fastac.sim.check_stream import check

BITS = 9


def packed(slopes, over, dark, lanes):
    """Beats of pixels (pixels, 2), (pixels, 2) and (pixels,) as payloads, without `dark` where it is None."""
    fields = [(slopes, BITS), (over, 1)] + ([(dark[:, None], 1)] if dark is not None else [])
    beats = []
    for start in range(0, len(slopes), lanes):
        word = place = 0
        for values, bits in fields:
            for value in values[start : start + lanes].ravel():
                word |= (int(value) & ((1 << bits) - 1)) << place
                place += bits
        beats.append(word)
    return beats


def masks(rng, height, width):
    """Dark pixels (frames, H, W): none, all, single ones, gaps of all widths at all places, and at random."""
    lone = np.eye(height, width, dtype=bool)
    gaps = np.array([[(u - 3 * v) % width < v + 1 for u in range(width)] for v in range(height)])
    random = rng.random((3, height, width)) < np.array([0.2, 0.5, 0.9])[:, None, None]
    return np.stack([0 * lone, 1 | lone, lone, ~lone, gaps, *random]).astype(bool)


@pytest.mark.parametrize(
    ("lanes", "reach", "fold"),
    [(1, 1, 1), (1, 4, 1), (2, 3, 1), (2, 4, 1), (4, 1, 1), (4, 4, 1), (4, 6, 1), (1, 4, 4), (1, 3, 16)],
)
@pytest.mark.quick("4-6-1", "1-4-4")
def test_bit_exact_to_golden_model(tmp_path, lanes, reach, fold):
    rng = np.random.default_rng(reach)
    height, width = 8, 16
    bridge = SlopeBridge(DotWindows(np.full((2, 4), 100), 4, 1), reach)
    dark = masks(rng, height, width)
    slopes = rng.integers(-(1 << (BITS - 1)) + 1, 1 << (BITS - 1), (*dark.shape, 2))
    over = rng.random(slopes.shape) < 0.3
    dut = SlopeBridgeStream(bridge, slope_bits=BITS, lanes=lanes, fold=fold)
    beats, row = dark.size // lanes, width // lanes
    check(
        dut,
        "slope_bridge",
        tmp_path,
        inputs=packed(slopes.reshape(-1, 2), over.reshape(-1, 2), dark.ravel(), lanes),
        expected=packed(bridge(slopes, dark).reshape(-1, 2), bridge(over, dark).reshape(-1, 2), None, lanes),
        # Beats come as fast as they are taken: only what waits for a frame's end leaves at the fold's pace.
        latencies=[(k, k, dut.latency) for k in (0, 1, row - 1, row, beats - row, beats - 1) if fold == 1]
        + [(beats - 1, beats - 1, dut.latency)],
    )
    assert dut.latency == fold * (-(-reach // lanes) + 1) + 1
    wrong = SlopeBridge(bridge.windows, reach + 1)
    assert (wrong(slopes, dark) != bridge(slopes, dark)).any()


def test_a_reach_of_a_whole_row_is_refused():
    bridge = SlopeBridge(DotWindows(np.full((2, 2), 100), 4, 1), 8)
    with pytest.raises(ValueError, match="reach 8: expected less than a row of 8 px"):
        SlopeBridgeStream(bridge, slope_bits=BITS, lanes=2)
