# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.arithmetic.frame_sum import FrameAccumulator, tree_levels
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack


@pytest.mark.parametrize(("beats", "axes", "words"), [(6, 2, 3), (5, 1, 1), (7, 3, 8)])
@pytest.mark.parametrize("stall", [0, 0.4])
@pytest.mark.quick("0-6-2-3", "0.4-7-3-8", "0-5-1-1")
def test_sums_of_frames_reach_their_bounds(beats, axes, words, stall):
    """Frames 0 and 1 are at the bounds, with the constant's sign and the opposite; the rest is random."""
    rng = np.random.default_rng(beats)
    bounds = rng.integers(0, 100, (beats, axes, words))
    bounds[:, -1] = 0  # the last axis has only zeros
    constant = rng.integers(-3000, 3000, axes)
    x = rng.integers(-bounds, bounds + 1, (6, *bounds.shape))
    sign = np.sign(constant)[:, None]
    x[0], x[1] = bounds * sign, -bounds * sign
    expected = constant + x.sum(axis=(1, 3))
    dut = FrameAccumulator(bounds, constant)
    largest = int(np.abs(expected[0]).max())
    assert largest < 1 << (dut.width - 1) <= 2 * largest, "the bound is reached, and no bit is unused"
    inputs = pack(x.reshape(-1, axes * words), dut.word_width)
    payloads, taken = run_streams(dut, inputs, {"o": 6}, stall=stall)
    assert payloads["o"] == pack(expected, dut.width)
    if not stall:
        assert dut.latency == tree_levels(words) + 1
        last = taken["i"][beats - 1 :: beats]
        assert [t - s for s, t in zip(last, taken["o"], strict=True)] == [dut.latency] * 6
        assert np.diff(taken["o"]).tolist() == [dut.interval] * 5, "frames follow without a gap"


FRAMES = 16
"""As many that the pipeline is seen to wait, with the next frame behind, at every stall."""


def test_sums_under_verilator(tmp_path):
    rng = np.random.default_rng(1)
    bounds, constant = rng.integers(0, 1 << 20, (9, 2, 5)), np.array([-(1 << 22), 12345])
    dut = FrameAccumulator(bounds, constant)
    rng = np.random.default_rng(2)
    x = rng.integers(-bounds, bounds + 1, (FRAMES, *bounds.shape))
    x[0], x[1] = bounds, -bounds
    check(
        dut,
        "frame_accumulator",
        tmp_path,
        elastic=True,
        inputs=pack(x.reshape(-1, 10), dut.word_width),
        expected=pack(constant + x.sum(axis=(1, 3)), dut.width),
        mask=(1 << 2 * dut.width) - 1,
        latencies=[(9 * f + 8, f, dut.latency) for f in range(FRAMES)],
    )


def test_adder_tree_levels():
    assert [tree_levels(n) for n in (1, 2, 3, 4, 5, 8, 9)] == [0, 1, 2, 2, 3, 3, 4]
