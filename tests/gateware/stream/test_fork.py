# amaranth: UnusedElaboratable=no
"""Fork under Amaranth's own simulator, since sim.check_stream has one output only."""

import random

import pytest
from amaranth.hdl import unsigned
from amaranth.sim import Simulator

from fastac.gateware.stream.fork import Fork

BEATS = 200


def run(ways, stall, input_stall):
    """Send BEATS beats; returns the payloads sent, those of each output, and [clocks until the last beat]."""
    dut = Fork(unsigned(8), ways)
    sent = [k % 256 for k in range(BEATS)]
    taken = [[] for _ in range(ways)]
    clocks = []

    async def source(ctx):
        rng = random.Random(1)
        for beat in sent:
            while rng.random() < input_stall:
                await ctx.tick()
            ctx.set(dut.i.payload, beat)
            ctx.set(dut.i.valid, 1)
            await ctx.tick().until(dut.i.ready)
            ctx.set(dut.i.valid, 0)

    async def sinks(ctx):
        rng = random.Random(2)
        offered = [None] * ways  # beats that are valid but not accepted: they must stay valid
        for clock in range(100 * BEATS):
            for o, probability in zip(dut.o, stall, strict=True):
                ctx.set(o.ready, rng.random() >= probability)
            _, _, *now = await ctx.tick().sample(*(s for o in dut.o for s in (o.valid, o.ready, o.payload)))
            for k in range(ways):
                valid, ready, payload = now[3 * k : 3 * k + 3]
                assert offered[k] is None or (valid and payload == offered[k]), f"output {k} withdrew a beat"
                offered[k] = payload if valid and not ready else None
                if valid and ready:
                    taken[k].append(payload)
            if all(len(beats) >= BEATS for beats in taken):
                clocks.append(clock + 1)
                break
        for _ in range(8):  # nothing more may come
            _, _, *more = await ctx.tick().sample(*(o.valid for o in dut.o))
            assert not any(more)

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(source)
    simulator.add_testbench(sinks)
    simulator.run()
    return sent, taken, clocks


@pytest.mark.parametrize("stall", [(0, 0), (0.3, 0), (0.6, 0.9), (0.3, 0.9, 0.5), (0.9,)])
@pytest.mark.parametrize("input_stall", [0, 0.5])
@pytest.mark.quick("0-stall0", "0.5-stall3", "0-stall2", "0.5-stall4")
def test_every_output_takes_every_beat_once(stall, input_stall):
    sent, taken, clocks = run(len(stall), stall, input_stall)
    assert clocks, "hang"
    for beats in taken:
        assert beats == sent
    if not input_stall and not any(stall):
        assert clocks == [BEATS], "one beat a clock"


def test_valid_of_an_output_ignores_ready_of_all():
    dut = Fork(unsigned(1), 3)

    async def bench(ctx):
        ctx.set(dut.i.valid, 1)
        for word in range(8):
            for k, o in enumerate(dut.o):
                ctx.set(o.ready, word >> k & 1)
            assert all(ctx.get(o.valid) for o in dut.o)
            assert ctx.get(dut.i.ready) == (word == 7)

    simulator = Simulator(dut)
    simulator.add_testbench(bench)
    simulator.run()


def test_invalid_arguments():
    with pytest.raises(ValueError, match="ways 0: expected at least 1"):
        Fork(unsigned(8), 0)
