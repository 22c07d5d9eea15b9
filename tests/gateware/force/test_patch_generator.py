# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from fastac.gateware.force.patch_generator import PatchGenerator
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack


def beats(frames, lanes, rng=None):
    """Frames (F, N, N, …) to beats (F·N·ceil(N/lanes), lanes, …); unused lanes 0, or random with `rng`."""
    f, n = frames.shape[:2]
    fill = np.zeros((f, n, -n % lanes, *frames.shape[3:]), dtype=np.int64)
    if rng is not None:
        fill = rng.integers(0, 1 << 16, fill.shape)
    return np.concatenate([frames, fill], axis=2).reshape(-1, lanes, *frames.shape[3:])


def patches(frames, k):
    half = k // 2
    padded = np.pad(frames, [(0, 0), (half, half), (half, half)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, (k, k), axis=(1, 2))
    return windows.reshape(*frames.shape, k * k)


@pytest.mark.parametrize(("n", "k", "bits", "lanes"), [(9, 3, 8, 4), (10, 5, 8, 2)])
@pytest.mark.quick("10-5-8-2")
def test_patches_of_every_pixel(tmp_path, n, k, bits, lanes):
    rng = np.random.default_rng(1)
    frames = rng.integers(0, 1 << bits, (8, n, n))
    frames[0] = (1 << bits) - 1  # any sample outside the frame that is not replaced with 0 shows
    frames[2] = 0
    frames[2, [0, 0, -1, -1], [0, -1, 0, -1]] = (1 << bits) - 1
    dut = PatchGenerator(n, k, bits, lanes=lanes)
    words = beats(patches(frames, k), lanes)
    present = beats(np.full((*frames.shape, k * k), -1), lanes)
    assert dut.latency == (k // 2) * -(-n // lanes) + -(-(k // 2) // lanes) + 3
    assert dut.interval == n * -(-n // lanes)
    check(
        dut,
        "patch_generator",
        tmp_path,
        inputs=pack(beats(frames, lanes, rng), bits),
        expected=pack(words, bits),
        mask=pack(present, bits),
        latencies=[(b, b, dut.latency) for b in range(len(words))],
    )


@pytest.mark.parametrize("fold", [4, 16])
@pytest.mark.quick("4")
def test_patches_at_a_pace(fold):
    """A beat in `fold` clocks at most; the last patches of a frame leave as slowly."""
    rng = np.random.default_rng(fold)
    n, k = 5, 3
    frames = rng.integers(0, 1 << 4, (3, n, n))
    inputs = pack(frames.reshape(-1, 1), 4)
    expected = pack(patches(frames, k).reshape(-1, k * k), 4)
    for stall in (0, {"i": 0.4, "o": 0.8}):
        dut = PatchGenerator(n, k, 4, lanes=1, fold=fold)
        assert dut.latency == fold * (n + 1) + 3
        assert dut.interval == fold * n * n
        payloads, taken = run_streams(dut, inputs, {"o": len(expected)}, stall=stall)
        assert payloads["o"] == expected
        assert np.diff(taken["i"]).min() >= fold
        if stall == 0:
            assert np.diff(taken["o"]).tolist() == [fold] * (len(expected) - 1)
            assert {t - s for s, t in zip(taken["i"], taken["o"], strict=True)} == {dut.latency}


def test_invalid_arguments():
    with pytest.raises(ValueError, match="lanes 3: expected one of"):
        PatchGenerator(9, 3, 8, lanes=3)
    with pytest.raises(ValueError, match="kernel_size 4: expected one of"):
        PatchGenerator(9, 4, 8, lanes=1)
    with pytest.raises(ValueError, match="size 4: expected at least 5"):
        PatchGenerator(4, 5, 8, lanes=1)
    with pytest.raises(ValueError, match="bits 0: expected at least 1"):
        PatchGenerator(9, 3, 0, lanes=1)
