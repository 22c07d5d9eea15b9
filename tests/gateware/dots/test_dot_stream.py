# amaranth: UnusedElaboratable=no
"""From darkness to shifts: equal to the integers, at the camera's rate, after the clocks that are stated."""

from dataclasses import replace

import dots
import numpy as np
import pytest
from amaranth.back import rtlil

from fastac.gateware.dots.dot_stream import DotStream
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack

SIDE = 48


def frames_of(side):
    rest = dots.places(side, side)
    rng = np.random.default_rng(1)
    near = np.exp(-((rest - side / 2) ** 2).sum(axis=-1, keepdims=True) / 300)
    moved = [dots.frame(side, side, rest + near * push) for push in ((0, 0), (5, 3), (-4, -5), (0, 7))]
    noise = rng.integers(0, 256, moved[0].shape).astype(np.uint8)
    return np.stack([*moved, noise, moved[1]])


def payloads(follower, frames):
    return dots.shift_payloads(follower, *follower(follower.windows(frames)))


def darkness(follower, frames, lanes):
    windows = follower.windows
    return pack(windows.darkness(frames).reshape(-1, lanes), windows.darkness_width)


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.quick("4")
def test_at_full_rate(lanes):
    """The input never waits, and each frame's last dot comes `latency` clocks after its last pixels."""
    follower = dots.follower(SIDE, SIDE)
    frames = frames_of(SIDE)
    dut = DotStream(follower, lanes=lanes)
    expected = payloads(follower, frames)
    inputs = darkness(follower, frames, lanes)
    found, taken = run_streams(dut, inputs, {"o": len(expected)}, clocks=200_000)
    assert found["o"] == expected
    assert np.diff(taken["i"]).max() == 1, "no pause"
    last = taken["i"][dut.interval - 1 :: dut.interval]
    ends = taken["o"][len(follower.rest) - 1 :: len(follower.rest)]
    assert [end - start for start, end in zip(last, ends, strict=True)] == [dut.latency] * len(frames)


def test_loaded_dots_at_full_rate():
    """Nor does the input wait for dots that were loaded, out of the order of their rows."""
    usual, frames = dots.follower(SIDE, SIDE), frames_of(SIDE)
    built = replace(usual, windows=replace(usual.windows, loadable=True))
    away = np.random.default_rng(2).integers(-128, 129, usual.rest.shape)
    follower = replace(built, rest=built.rest + away)
    assert (follower.needed_rows != follower.rows[0]).any()
    dut, other = DotStream(built, lanes=4), DotStream(follower, lanes=4)
    table, expected = other.dots.table, payloads(follower, frames)
    found, taken = run_streams(
        dut,
        darkness(follower, frames, 4),
        {"o": len(expected)},
        tables={"write": pack(table.values, table.format.bits)},
    )
    assert found["o"] == expected
    assert np.diff(taken["i"]).max() == 1, "no pause"
    last, ends = taken["i"][dut.interval - 1 :: dut.interval], taken["o"][len(away) - 1 :: len(away)]
    assert [end - start for start, end in zip(last, ends, strict=True)] == [other.latency] * len(frames)


def test_dots_of_the_upper_half_are_known_before_the_frame_ends():
    every = dots.follower(SIDE, SIDE)
    kept = every.rest_px[:, 1] < SIDE // 3
    count = int(kept.sum())
    guides = np.where(every.guides[kept] == len(kept), count, every.guides[kept])
    parts = {name: getattr(every, name)[kept] for name in ("rest", "low", "high")}
    follower = replace(every, **parts, guides=guides)
    frames, dut = frames_of(SIDE), DotStream(follower, lanes=4)
    expected = payloads(follower, frames)
    found, taken = run_streams(dut, darkness(follower, frames, 4), {"o": len(expected)})
    assert found["o"] == expected
    last, ends = taken["i"][dut.interval - 1 :: dut.interval], taken["o"][count - 1 :: count]
    assert [end - start for start, end in zip(last, ends, strict=True)] == [dut.latency] * len(frames)
    assert dut.latency < 0


@pytest.mark.long
@pytest.mark.full
def test_with_stalls_in_verilator(tmp_path):
    follower = dots.follower(SIDE, SIDE)
    frames = frames_of(SIDE)
    dut = DotStream(follower, lanes=4)
    inputs = darkness(follower, frames, 4)
    check(dut, "dot_stream", tmp_path, inputs=inputs, expected=payloads(follower, frames))


def test_a_hundred_dots_at_full_size_are_known_256_clocks_after_the_last_pixel():
    follower = dots.follower(128, 128, half=2, reach=4)
    assert len(follower.rest) == 144
    dut = DotStream(follower, lanes=4)
    assert dut.latency <= 256
    assert dut.interval == 4096


def test_there_is_no_product():
    """Yosys would make multipliers of products by constants too."""
    text = rtlil.convert(DotStream(dots.follower(SIDE, SIDE, half=2, reach=2), lanes=4))
    assert "$add" in text
    assert "$mul" not in text
