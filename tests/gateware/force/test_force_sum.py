# amaranth: UnusedElaboratable=no
"""Sums of both parts of the force: all values, either part first, with pauses and back-pressure."""

import random

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import pack

DOTS, SKIN_WIDTH = 5, 9
SKIN_LIMIT = (1 << (SKIN_WIDTH - 1)) - 1
CLOCKS = 4000


def parts(axes: int):
    """The dots' share, and of each frame the skin's sums and the dots' shifts.

    The first frames have sums of 0 in one part or both, the next ones the largest of either sign.
    """
    rng = np.random.default_rng(axes)
    weight = rng.integers(-31, 32, (axes, DOTS, 1, 2))
    weighted = WeightedSum(weight, np.zeros(axes, np.int64), 7, True)
    dot_force = DotForce(weighted, np.array([3, 0, 5])[:axes])
    limit = weighted.input_limit
    most = np.where(weight[:, :, 0] > 0, limit, -limit)  # of each axis
    none, top = 0 * most[0], np.full(axes, SKIN_LIMIT)
    given = [(0 * top, none), (top, none), (-top, none), (0 * top, most[0]), (0 * top, -most[-1])]
    given += [(sign * top, other * shift) for shift in most for sign in (1, -1) for other in (1, -1)]
    for _ in range(60):
        given.append(
            (rng.integers(-SKIN_LIMIT, SKIN_LIMIT + 1, axes), rng.integers(-limit, limit + 1, none.shape))
        )
    skin, shifts = (np.array(values) for values in zip(*given, strict=True))
    return dot_force, skin, shifts


def component(dot_force: DotForce) -> ForceSum:
    return ForceSum(dot_force, skin_width=SKIN_WIDTH, width=signed_width(SKIN_LIMIT + dot_force.bound))


def run(dut, words: dict[str, list[int]], *, begin: dict[str, int], stall: float = 0.0):
    """Send the words of both parts; returns the sums, and the clocks of the transfers at each port.

    begin : clocks before the first word of each port; at `o`, before it is ready
    """
    found, taken = [], {name: [] for name in ("skin", "dots", "o")}

    def source(name):
        async def send(ctx):
            port, rng, clock = getattr(dut, name), random.Random(name), begin[name]
            await ctx.tick().repeat(clock) if clock else None
            for word in words[name]:
                while rng.random() < stall:
                    await ctx.tick()
                    clock += 1
                ctx.set(port.payload.as_value(), word)
                ctx.set(port.valid, 1)
                moved = False
                while not moved:
                    *_, moved = await ctx.tick().sample(port.ready)
                    clock += 1
                taken[name].append(clock - 1)
                ctx.set(port.valid, 0)
                ctx.set(port.payload.as_value(), rng.getrandbits(16))

        return send

    async def sink(ctx):
        rng, offered, idle = random.Random(3), None, 0
        for clock in range(CLOCKS):
            ready = clock >= begin["o"] and rng.random() >= stall
            ctx.set(dut.o.ready, ready)
            *_, valid, payload = await ctx.tick().sample(dut.o.valid, dut.o.payload.as_value())
            assert offered is None or (valid and payload == offered), "a sum was withdrawn"
            offered = payload if valid and not ready else None
            if valid and ready:
                found.append(payload)
                taken["o"].append(clock)
            idle = idle + 1 if len(found) >= len(words["skin"]) else 0
            if idle > 16:  # nothing more may come
                return
        raise AssertionError(f"hang: {len(found)} sums")

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    for name in words:
        simulator.add_testbench(source(name))
    simulator.add_testbench(sink)
    simulator.run()
    return found, taken


def words_of(dot_force, skin, shifts):
    weighted = dot_force.weighted
    return {"skin": pack(skin, SKIN_WIDTH), "dots": pack(weighted(shifts[..., None, :]), weighted.width)}


@pytest.mark.parametrize("axes", [3, 1])
@pytest.mark.parametrize(
    ("skin_first", "dots_first"), [(0, 0), (0, 1), (0, FRAMES_IN_FLIGHT), (FRAMES_IN_FLIGHT, 0)]
)
def test_sum_of_every_frame(axes, skin_first, dots_first):
    """The sum comes `latency` clocks after the later part, and none waits for the other."""
    dot_force, skin, shifts = parts(axes)
    dut = component(dot_force)
    expected = skin + dot_force(shifts)
    assert np.abs(expected).max() == SKIN_LIMIT + dot_force.bound, "the bound is reached"
    begin = {"skin": dots_first, "dots": skin_first, "o": 0}
    found, taken = run(dut, words_of(dot_force, skin, shifts), begin=begin)
    assert found == pack(expected, len(dut.o.payload.as_value()) // axes)
    count = min(FRAMES_IN_FLIGHT, len(found))
    for name in ("skin", "dots"):
        first = begin[name]
        assert taken[name][:count] == list(range(first, first + count)), "nothing waits"
    later = np.maximum(taken["skin"], taken["dots"])
    assert dut.latency == 2
    assert (np.array(taken["o"]) - later == dut.latency)[:count].all()
    assert (np.diff(taken["o"]) == 1)[: count - 1].all(), "a sum a clock"


@pytest.mark.parametrize("stall", [0.3, 0.7])
def test_pauses(stall):
    dot_force, skin, shifts = parts(3)
    dut = component(dot_force)
    found, _ = run(dut, words_of(dot_force, skin, shifts), begin={"skin": 0, "dots": 0, "o": 0}, stall=stall)
    assert found == pack(skin + dot_force(shifts), len(dut.o.payload.as_value()) // 3)


def test_each_part_waits_when_its_queue_is_full():
    dot_force, skin, shifts = parts(3)
    words = words_of(dot_force, skin, shifts)
    expected = pack(skin + dot_force(shifts), signed_width(SKIN_LIMIT + dot_force.bound))
    late = 3 * FRAMES_IN_FLIGHT
    for waiting, other in (("skin", "dots"), ("dots", "skin")):
        found, taken = run(component(dot_force), words, begin={waiting: 0, other: late, "o": 0})
        assert found == expected
        assert sum(clock < late for clock in taken[waiting]) == FRAMES_IN_FLIGHT
    # Without a reader the register holds one more frame of both.
    found, taken = run(component(dot_force), words, begin={"skin": 0, "dots": 0, "o": late})
    assert found == expected
    for name in ("skin", "dots"):
        assert sum(clock < late for clock in taken[name]) == FRAMES_IN_FLIGHT + 1
