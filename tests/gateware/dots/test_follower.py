# amaranth: UnusedElaboratable=no
"""The follower finds the dots of its integers: moved, lost, doubled, near the edge, with stalls."""

from dataclasses import replace

import dots
import numpy as np
import pytest

from fastac.gateware.dots.follower import DotFollowerStream
from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.models.integer.dot_follower import FRACTION, DotFollower, guides_of
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack

HEIGHT, WIDTH = 36, 44
A_SLOW_READER = (0, 0.96)
"""Shares of pauses: windows come without any, and dots have to wait for long. Rows that they or later ones
need must not be overwritten."""


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
    # In every other frame most dots stay within the reach of their windows.
    factor[::2] = np.where(rng.random((*shape, 2))[::2] < 0.8, steps[::2] / 8, factor[::2])
    moment = np.rint(mass[..., None] * factor) + rng.integers(-1, 2, (*shape, 2))
    reach = np.minimum(mass * span, windows.moment_bound)[..., None]
    moment = np.clip(moment, -reach, reach)
    return np.concatenate([mass[..., None], moment.astype(np.int64)], axis=-1)


def farthest_windows(windows):
    """The centre of darkness of all windows at the same one of their corners and edges, or in the middle."""
    mass, span = 64, 4 * windows.half + 1
    ways = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    moments = np.broadcast_to(ways[:, None, None] * mass * span, (len(ways), *windows.shape, 2))
    return np.concatenate([np.full((*moments.shape[:-1], 1), mass), moments], axis=-1)


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
    given = farthest_windows(windows)
    shift, seen = follower(given)
    assert seen.all()
    assert np.abs(shift).max() == follower.bound
    dut = stream(follower, 4)
    found, _ = run_streams(dut, dots.payloads(windows, given, dut.per_beat), {"o": seen.size})
    assert found["o"] == dots.shift_payloads(follower, shift, seen)


@pytest.mark.full
@pytest.mark.mutate
def test_stream_rules_in_verilator(tmp_path):
    usual = dots.follower(HEIGHT, WIDTH, half=2, reach=2)
    windows = np.concatenate([usual.windows(frames_of()), random_windows(usual, 50)])
    # Dots on the right count as seen, whatever their darkness; others have limits of any size.
    always = usual.rest_px[:, 0] > WIDTH / 2
    most = usual.windows.mass_bound
    low, high = np.sort(np.random.default_rng(4).integers(1, most, (2, len(always))), axis=0)
    follower = replace(usual, low=np.where(always, 1, low), high=np.where(always, most, high))
    windows = np.concatenate([windows, random_windows(follower, 30), farthest_windows(usual.windows)])
    dut = stream(follower, 4)
    check(
        dut,
        "dot_follower",
        tmp_path,
        inputs=dots.payloads(follower.windows, windows, dut.per_beat),
        expected=dots.shift_payloads(follower, *follower(windows)),
        stalls=(0, 0.3, 0.9, A_SLOW_READER),
    )


def test_too_many_dots_for_the_rate_are_refused():
    follower = dots.follower(HEIGHT, WIDTH)
    with pytest.raises(ValueError, match=r"dot at \d+, \d+ px: found \d+ clocks too late"):
        DotFollowerStream(follower, per_beat=2, row_clocks=8)


def test_guides_and_limits_are_checked():
    follower = dots.follower(HEIGHT, WIDTH)
    with pytest.raises(ValueError, match="guides: expected indices of earlier dots"):
        replace(follower, guides=follower.guides * 0 + 1)
    with pytest.raises(ValueError, match="low 0: expected at least 1"):
        replace(follower, low=follower.low * 0)


def loadable(follower):
    """The same dots, of hardware that can be loaded with others."""
    return replace(follower, windows=replace(follower.windows, loadable=True))


def out_of_order(follower):
    """The dots in columns, from the right to the left, so that none is in the order of its row."""
    u, v = follower.rest_px.T
    order = np.lexsort((v, -(u // 8)))
    parts = {name: getattr(follower, name)[order] for name in ("rest", "low", "high")}
    guides = guides_of(parts["rest"] * 2.0**-FRACTION, dots.SPACING_PX)
    return replace(follower, **parts, guides=guides), order


@pytest.mark.parametrize("stall", [0, 0.5])
def test_dots_in_any_order(stall):
    """Rows are kept until the last dot that may read them has been followed."""
    usual = dots.follower(HEIGHT, WIDTH, half=1, reach=1)
    follower, order = out_of_order(usual)
    windows = random_windows(follower, 10)
    shift, seen = follower(windows)
    plain = replace(follower, guides=0 * follower.guides + len(order))
    by_row = replace(usual, guides=plain.guides)
    for found, expected in zip(plain(windows), by_row(windows), strict=True):
        np.testing.assert_array_equal(found, expected[:, order])
    dut = stream(follower, 1)
    assert dut.kept_rows > stream(usual, 1).kept_rows
    inputs = dots.payloads(usual.windows, windows, dut.per_beat)
    found, _ = run_streams(dut, inputs, {"o": seen.size}, stall=stall)
    assert found["o"] == dots.shift_payloads(follower, shift, seen)


def moved(follower, px, seed=3):
    """The dots up to `px` away from where they are at rest, each with other limits."""
    rng = np.random.default_rng(seed)
    ends = (np.array(follower.windows.image[::-1]) << FRACTION) - (1 << FRACTION)
    rest = follower.rest + rng.integers(-px << FRACTION, (px << FRACTION) + 1, follower.rest.shape)
    return replace(
        follower,
        rest=np.clip(rest, 0, ends),
        low=follower.low + rng.integers(0, 9, len(rest)),
        high=follower.high * 2 + rng.integers(0, 9, len(rest)),
    )


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.quick("4")
def test_loaded_dots(lanes):
    """Hardware with other dots than those it was built with, at rest elsewhere and out of order."""
    built = loadable(dots.follower(HEIGHT, WIDTH, half=1, reach=2))
    windows = np.concatenate([built.windows(frames_of()), random_windows(built, 5)])
    for seed in (3, 4):
        follower = moved(built, 2, seed)
        assert (follower.needed_rows != follower.rows[0]).any()
        shift, seen = follower(windows)
        dut, other = stream(built, lanes), stream(follower, lanes)
        assert dut.table.format == other.table.format
        assert (dut.kept_rows, dut.o.signature) == (other.kept_rows, other.o.signature)
        found, _ = run_streams(
            dut,
            dots.payloads(follower.windows, windows, dut.per_beat),
            {"o": seen.size},
            tables={"write": pack(other.table.values, other.table.format.bits)},
        )
        assert found["o"] == dots.shift_payloads(follower, shift, seen)


def test_words_hold_dots_anywhere():
    """Where dots can be loaded, shifts and records have the same words wherever dots are, and hold them."""
    built = loadable(dots.follower(HEIGHT, WIDTH, half=2, reach=2))
    ends = (np.array([WIDTH, HEIGHT]) << FRACTION) - (1 << FRACTION) // 2 - 1
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * ends
    mass = built.windows.mass_bound
    for rest in (corners, corners // 2, corners[::-1] // 3):
        none = np.full((4, 2), 4)
        follower = DotFollower(built.windows, rest, none, np.full(4, mass + 9), np.full(4, 1 << 40), 2)
        assert follower.bound == built.bound
        fixed = replace(follower, windows=replace(built.windows, loadable=False))
        assert fixed.bound <= follower.bound
        dut = stream(follower, 4)
        assert dut.table.format.bits == stream(built, 4).table.format.bits
        records = dut.table.records
        assert {record["least"] for record in records} == {mass + 1}
        assert [(record["rest_u"], record["rest_v"]) for record in records] == [tuple(r) for r in rest]
    assert replace(follower, rest=corners, windows=fixed.windows).bound == built.bound


def test_dots_too_far_from_the_order_of_their_rows_are_refused():
    follower, _ = out_of_order(loadable(dots.follower(96, WIDTH)))
    with pytest.raises(ValueError, match=r"dot at \d+, \d+ px: found \d+ clocks too late, .* come before it"):
        stream(follower, 4)
