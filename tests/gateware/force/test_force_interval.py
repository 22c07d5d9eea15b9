# amaranth: UnusedElaboratable=no
"""Half-widths of every frame, whichever of its measures and its force come first, with any weights."""

import random

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.force.force_interval import ForceIntervalStream
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer.force_interval import BASE_BITS, LOAD, WEIGHT_BITS, ForceInterval
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import pack

VALIDITY = FrameValidity.unlimited((6, 6, 3), slopes=True, displacements=False)
FORCE_LIMIT = (1 << 29) - 5
FORCE_WIDTH = signed_width(FORCE_LIMIT)
ALL = ("change", "gradient", "brightness_b", "clipped", LOAD)
FRAMES = 12
CLOCKS = 6000


def stage(rng, measures: tuple[str, ...], axes: int, *, largest: bool = False) -> ForceInterval:
    """An interval of the measures with random weights, or with the largest that there are."""
    bounds = dict(zip(VALIDITY.names, VALIDITY.bounds[1].tolist(), strict=True)) | {LOAD: FORCE_LIMIT}
    limits = np.array([bounds[name] for name in measures], np.int64)
    shifts = np.maximum([signed_width(int(limit)) - 10 for limit in limits], 0)
    weights = rng.integers(0, 1 << WEIGHT_BITS, (axes, len(measures)))
    base = rng.integers(0, 1 << BASE_BITS, axes)
    if largest:
        weights[:], base[:] = (1 << WEIGHT_BITS) - 1, (1 << BASE_BITS) - 1
    else:
        weights[0, :1], base[-1] = 0, 0
    return ForceInterval(measures, limits, shifts, weights, base, np.array([-7, 2, -31])[:axes], axes - 1)


def stimulus(rng, interval: ForceInterval) -> tuple[np.ndarray, np.ndarray]:
    """Measures and forces: zero, the largest of either sign, the least of either sign, then random ones."""
    axes, limits = len(interval.base), interval.limits[: len(interval.pixel_measures)]
    measures = rng.integers(-limits, limits + 1, (FRAMES, len(limits)))
    forces = rng.integers(-FORCE_LIMIT, FORCE_LIMIT + 1, (FRAMES, axes))
    for frame, (measure, force) in enumerate(
        [(0, 0), (limits, FORCE_LIMIT), (-limits, -FORCE_LIMIT), (1, 1), (-1, -1), (0, -FORCE_LIMIT)]
    ):
        measures[frame], forces[frame] = measure, force
    one_sided = [name in ("clipped", "change", "detail", "gradient") for name in interval.pixel_measures]
    return np.where(one_sided, np.abs(measures), measures), forces


def run(dut, measures, forces, *, early: int, stall: float = 0.0, ready: float = 1.0):
    """Give measures and forces; returns half-widths, and the clocks of forces and half-widths.

    early : frames by which the measures may be ahead of the force; -1: they come after it
    """
    names, found, taken, clock_of = dut.integers.pixel_measures, [], [], []
    rng = random.Random(early)
    given = dict.fromkeys(dut.groups, 0)

    async def bench(ctx):
        if dut.loadable:
            ctx.set(dut.base.as_value(), dut.base_image)
        for clock in range(CLOCKS):
            if len(found) == len(forces):
                return
            ended, moves = len(taken), {}
            room = ctx.get(dut.room)
            have = min(given.values(), default=len(forces))
            # A force may be taken before its frame's measures where those come late.
            due = ended < len(forces) and (have >= min(ended + early - 1, len(forces)) if early > 0 else True)
            force_now = room and due and (early > 0 or have >= ended) and rng.random() >= stall
            ctx.set(dut.force.as_value(), pack(forces[min(ended, FRAMES - 1)][None], FORCE_WIDTH)[0])
            ctx.set(dut.force_taken, force_now)
            for name, group in dut.groups.items():
                k = given[name]
                limit = min(len(forces), len(found) + max(early, 1))
                moves[name] = k < limit and (early >= 0 or k < ended) and rng.random() >= stall
                word = getattr(dut, f"{name}_measures")
                for measure in group:
                    value = measures[min(k, FRAMES - 1), names.index(measure)] if moves[name] else -1
                    ctx.set(word[measure], int(value))
                ctx.set(getattr(dut, f"{name}_measured"), moves[name])
            takes = rng.random() < ready
            ctx.set(dut.o.ready, takes)
            if ctx.get(dut.o.valid) and takes:
                found.append(ctx.get(dut.o.payload.as_value()))
                clock_of.append(clock)
            await ctx.tick()
            if force_now:
                taken.append(clock)
            for name, moved in moves.items():
                given[name] += moved
        raise AssertionError(f"hang: {len(found)} half-widths")

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return found, np.array(taken), np.array(clock_of)


def expected(dut, measures, forces):
    halves = dut.integers.half_widths(measures, forces)
    return [sum(int(half) << (k * dut.half_width) for k, half in enumerate(row)) for row in halves]


def component(interval, *, loadable=False) -> ForceIntervalStream:
    return ForceIntervalStream(interval, VALIDITY, force_width=FORCE_WIDTH, loadable=loadable)


@pytest.mark.parametrize(
    ("measures", "axes", "loadable"),
    [
        (ALL, 3, False),
        (ALL, 2, True),
        (("gradient", LOAD), 1, False),
        (("clipped", "detail"), 2, False),
        ((LOAD,), 1, True),
    ],
)
def test_half_widths_of_every_frame(measures, axes, loadable):
    """With measures ahead a frame takes `interval` clocks, and half-widths come `latency` after the force."""
    rng = np.random.default_rng(axes)
    interval = stage(rng, measures, axes)
    values, forces = stimulus(rng, interval)
    dut = component(interval, loadable=loadable)
    words = expected(dut, values, forces)
    found, taken, clocks = run(dut, values, forces, early=FRAMES_IN_FLIGHT - 1)
    assert found == words
    assert (np.diff(clocks) == dut.interval).all()
    assert dut.preparation == len(interval.pixel_measures) * axes
    assert dut.interval == max(dut.preparation + axes + 5, axes + 6)
    assert dut.latency == axes + 5
    again = component(interval, loadable=loadable)
    found, taken, clocks = run(again, values, forces, early=-1)
    assert found == words
    again = component(interval, loadable=loadable)
    found, taken, clocks = run(again, values, forces, early=3, stall=0.9, ready=0.5)
    assert found == words
    assert (clocks - taken).min() == dut.latency


@pytest.mark.parametrize("loadable", [False, True])
def test_the_largest_sums_fit(loadable):
    rng = np.random.default_rng(1)
    interval = stage(rng, ALL, 3, largest=True)
    values, forces = stimulus(rng, interval)
    values[1], forces[1] = interval.limits[:-1], FORCE_LIMIT
    values[2] = np.where(
        [name.startswith("brightness") for name in interval.pixel_measures], -values[1], values[1]
    )
    dut = component(interval, loadable=loadable)
    assert dut.half_width == interval.half_width
    assert max(interval.half_widths(values, forces).max(axis=0)) >> (dut.half_width - 1) == 1
    found, *_ = run(dut, values, forces, early=2)
    assert found == expected(dut, values, forces)


def test_limits_must_hold_what_the_hardware_can_measure():
    interval = stage(np.random.default_rng(0), ALL, 1)
    with pytest.raises(ValueError, match=r"limit of load .*: expected one of 31 bits"):
        ForceIntervalStream(interval, VALIDITY, force_width=FORCE_WIDTH + 1)
    larger = FrameValidity.unlimited((60, 60, 3), slopes=True, displacements=False)
    with pytest.raises(ValueError, match="limit of change"):
        ForceIntervalStream(interval, larger, force_width=FORCE_WIDTH)
