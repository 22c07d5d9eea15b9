# amaranth: UnusedElaboratable=no
"""The follower finds the dots of its integers: moved, lost, doubled, near the edge, with stalls."""

from dataclasses import replace

import dots
import numpy as np
import pytest

from fastac.gateware.dots.follower import DotFollowerStream
from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check

HEIGHT, WIDTH = 36, 44


def frames_of(height=HEIGHT, width=WIDTH):
    """Frames with dots at rest, moved alike and apart, none, one missing, one added, smeared, all dark."""
    rng, rest = np.random.default_rng(1), dots.places(height, width)

    def moved(shift):
        return dots.frame(height, width, rest + shift)

    middle = np.array([width / 2, height / 2])
    push = np.exp(-((rest - middle) ** 2).sum(axis=-1, keepdims=True) / 200) * [5, -3]
    covered = moved(push)
    covered[5:15, 3:13] = dots.SKIN
    smeared = moved(-push)
    smeared[20:32, 15:40] //= 2
    noise = rng.integers(0, 256, covered.shape).astype(np.uint8)
    added = dots.frame(height, width, np.concatenate([rest, rest[3:4] + 4]))
    given = [rest * 0, 2.4, [-6, 1], [3, 6], push, -push, rng.normal(0, 1.5, rest.shape)]
    return np.stack([*map(moved, given), covered, smeared, added, noise, 0 * noise, 0 * noise + 255])


def random_windows(follower, count):
    """Windows that no image has: each of any mass, near the limits of what is seen too, and any centre."""
    rng, windows = np.random.default_rng(2), follower.windows
    shape = (count, *windows.shape)
    near = np.concatenate([follower.low, follower.high])[:, None] + (-1, 0, 1)
    mass = rng.choice([0, 1, windows.mass_bound, *near.ravel()], shape)
    mass = np.where(rng.random(shape) < 0.3, rng.integers(0, windows.mass_bound + 1, shape), mass)
    # Centres anywhere; at the edges where another window is nearer; at which a quotient's last bit changes.
    span = 4 * windows.half + 1
    steps = rng.integers(-64 * span, 64 * span + 1, (*shape, 2)) / 64
    edges = rng.choice([-6, -2, 0, 2, 6, span], (*shape, 2))
    factor = np.where(rng.random((*shape, 2)) < 0.4, edges, steps)
    moment = np.rint(mass[..., None] * factor) + rng.integers(-1, 2, (*shape, 2))
    reach = np.minimum(mass * span, windows.moment_bound)[..., None]
    moment = np.clip(moment, -reach, reach)
    return np.concatenate([mass[..., None], moment.astype(np.int64)], axis=-1)


def stream(follower, lanes):
    per_beat = DotWindowStream(follower.windows, lanes=lanes).per_beat
    return DotFollowerStream(follower, per_beat=per_beat, row_clocks=2 * follower.windows.image[1] // lanes)


@pytest.mark.parametrize(("lanes", "half", "reach"), [(1, 1, 3), (2, 1, 2), (4, 1, 3), (4, 2, 2)])
@pytest.mark.quick("4-1-3", "1-1-3")
def test_every_dot_of_every_frame(lanes, half, reach):
    follower = dots.follower(HEIGHT, WIDTH, half=half, reach=reach)
    windows = follower.windows(frames_of())
    shift, seen = follower(windows)
    assert seen[0].all()
    assert not shift[0].any()
    assert not seen[-1].any()
    assert 0 < seen[7:10].mean() < 1, "some dots are lost or doubled"
    for stall in (0, 0.5):
        dut = stream(follower, lanes)
        inputs = dots.payloads(follower.windows, windows, dut.per_beat)
        found, _ = run_streams(dut, inputs, {"o": seen.size}, stall=stall)
        assert found["o"] == dots.shift_payloads(follower, shift, seen)


def test_any_windows():
    follower = dots.follower(HEIGHT, WIDTH, half=2, reach=2)
    windows = random_windows(follower, 40)
    shift, seen = follower(windows)
    assert 0.2 < seen.mean() < 0.9
    assert np.abs(shift).max() > 0.7 * follower.bound
    dut = stream(follower, 4)
    inputs = dots.payloads(follower.windows, windows, dut.per_beat)
    found, _ = run_streams(dut, inputs, {"o": seen.size})
    assert found["o"] == dots.shift_payloads(follower, shift, seen)


def test_shifts_up_to_the_bound():
    """Every dot is seen, and darkness steers it to its farthest window and to that window's edge."""
    usual = dots.follower(HEIGHT, WIDTH, half=2, reach=2)
    windows, none = usual.windows, 0 * usual.low
    follower = replace(usual, low=none + 1, high=none + windows.mass_bound)
    mass, span = 64, 4 * windows.half + 1
    ways = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    moments = np.broadcast_to(ways[:, None, None] * mass * span, (len(ways), *windows.shape, 2))
    given = np.concatenate([np.full((*moments.shape[:-1], 1), mass), moments], axis=-1)
    shift, seen = follower(given)
    assert seen.all()
    assert np.abs(shift).max() == follower.bound
    dut = stream(follower, 4)
    found, _ = run_streams(dut, dots.payloads(windows, given, dut.per_beat), {"o": seen.size})
    assert found["o"] == dots.shift_payloads(follower, shift, seen)


@pytest.mark.long
def test_stream_rules_in_verilator(tmp_path):
    usual = dots.follower(HEIGHT, WIDTH, half=2, reach=2)
    windows = np.concatenate([usual.windows(frames_of()), random_windows(usual, 150)])
    always = np.arange(len(usual.rest)) % 2 == 1  # every other dot counts as seen, whatever its darkness
    high = np.where(always, usual.windows.mass_bound, usual.high)
    follower = replace(usual, low=np.where(always, 1, usual.low), high=high)
    dut = stream(follower, 4)
    check(
        dut,
        "dot_follower",
        tmp_path,
        inputs=dots.payloads(follower.windows, windows, dut.per_beat),
        expected=dots.shift_payloads(follower, *follower(windows)),
    )


def test_too_many_dots_for_the_rate_are_refused():
    follower = dots.follower(HEIGHT, WIDTH)
    with pytest.raises(ValueError, match=r"dot at \d+, \d+ px: found \d+ clocks too late"):
        DotFollowerStream(follower, per_beat=2, row_clocks=8)


def test_the_order_of_dots_is_checked():
    follower = dots.follower(HEIGHT, WIDTH)
    with pytest.raises(ValueError, match="order of their rows"):
        replace(follower, rest=follower.rest[::-1])
    with pytest.raises(ValueError, match="guides: expected indices of earlier dots"):
        replace(follower, guides=follower.guides * 0 + 1)
    with pytest.raises(ValueError, match="low 0: expected at least 1"):
        replace(follower, low=follower.low * 0)
