# amaranth: UnusedElaboratable=no
"""The stream of windows equals its integers for all lanes and sizes, at the bounds, and with stalls."""

import numpy as np
import pytest
from dots import payloads

from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.models.integer.dot_windows import DotWindows
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack


def windows_of(height, width, half, darkest):
    return DotWindows(np.full((height // 4, width // 4), darkest), 4, half)


def frames_of(windows, rng):
    """Random darkness, none, the largest everywhere, each side of the image alone, single pixels."""
    height, width = windows.image
    random = rng.integers(0, windows.darkest + 1, (3, height, width))
    v, u = np.indices((height, width))
    sides = [u < width // 2, u >= width // 2, v < height // 2, v >= height // 2, (u + v) % 2 == 0]
    single = [(u == a) & (v == b) for a, b in ((0, 0), (width - 1, height - 1), (width // 2, height // 2))]
    full = np.full((height, width), windows.darkest)
    return np.stack(
        [*random, 0 * full, full, *(np.where(mask, full, 0) for mask in (*sides, *single)), random[0]]
    )


@pytest.mark.parametrize(
    ("lanes", "half", "height", "width"),
    [(1, 2, 16, 20), (2, 1, 12, 16), (4, 2, 20, 16), (4, 3, 20, 24), (1, 3, 16, 16), (2, 2, 16, 12)],
)
@pytest.mark.quick("2-1-12-16", "4-3-20-24", mutate=["1-2-16-20"])
def test_every_window(lanes, half, height, width):
    windows = windows_of(height, width, half, 700)
    dark = frames_of(windows, np.random.default_rng(half))
    expected = windows.of_darkness(dark)
    for stall in (0, 0.4):
        dut = DotWindowStream(windows, lanes=lanes)
        inputs = pack(dark.reshape(-1, lanes), windows.darkness_width)
        found, taken = run_streams(dut, inputs, {"o": expected[..., 0].size // dut.per_beat}, stall=stall)
        assert found["o"] == payloads(windows, expected, dut.per_beat)
        if not stall:
            last = taken["i"][height * width // lanes - 1 :: height * width // lanes]
            ends = taken["o"][dut.row_beats * windows.shape[0] - 1 :: dut.row_beats * windows.shape[0]]
            assert [end - start for start, end in zip(last, ends, strict=True)] == [dut.latency] * len(dark)


@pytest.mark.full
@pytest.mark.mutate
def test_stream_rules_in_verilator(tmp_path):
    windows = windows_of(20, 16, 2, 765)
    dark = frames_of(windows, np.random.default_rng(1))
    dut = DotWindowStream(windows, lanes=4)
    expected = windows.of_darkness(dark)
    check(
        dut,
        "dot_windows",
        tmp_path,
        inputs=pack(dark.reshape(-1, 4), windows.darkness_width),
        expected=payloads(windows, expected, dut.per_beat),
        elastic=True,
    )


def test_the_latency_at_full_size():
    dut = DotWindowStream(windows_of(128, 128, 2, 765), lanes=4)
    assert (dut.latency, dut.per_beat, dut.row_beats) == (11, 2, 30)
