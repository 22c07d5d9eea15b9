# amaranth: UnusedElaboratable=no
import random

import pytest
from amaranth.sim import Simulator

from fastac.gateware.packets.record_queue import RecordQueue


@pytest.mark.parametrize("frames", [2, 3, 8])
@pytest.mark.parametrize("slow", [0.0, 0.3, 0.9])
def test_no_record_is_lost(frames, slow):
    """Frames are let in whenever there is room; the one at the door may have its record already."""
    dut, rng = RecordQueue(frames=frames, bits=16), random.Random(1)
    given, taken, most = [], [], 0

    async def bench(ctx):
        nonlocal most
        inside = 0  # let in, of which a record may come
        for _ in range(2000):
            enters = ctx.get(dut.room) and rng.random() < 0.5
            gives = len(given) < inside + 1 and rng.random() < 0.6
            record = rng.getrandbits(16)
            ctx.set(dut.enters, enters)
            ctx.set(dut.record_valid, gives)
            ctx.set(dut.record, record if gives else 0)
            ctx.set(dut.o.ready, rng.random() >= slow and inside > len(taken))
            if ctx.get(dut.o.valid) and ctx.get(dut.o.ready):
                taken.append(ctx.get(dut.o.payload))
            if gives:
                given.append(record)
            inside += enters
            most = max(most, len(given) - len(taken))
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert taken == given[: len(taken)]
    assert len(taken) > 60
    if slow == 0.9:
        assert most == frames


def test_latency():
    dut, seen = RecordQueue(bits=4), []

    async def bench(ctx):
        ctx.set(dut.o.ready, 1)
        for clock in range(4):
            ctx.set(dut.record_valid, clock == 1)
            seen.append(ctx.get(dut.o.valid))
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert seen == [0] * (1 + dut.latency) + [1] + [0] * (2 - dut.latency)


def test_invalid_arguments():
    with pytest.raises(ValueError, match="frames 1: expected at least 2"):
        RecordQueue(frames=1)
