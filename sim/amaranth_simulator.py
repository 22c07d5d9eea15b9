"""Testbench in Amaranth's own simulator, for small designs and components with several output streams."""

import random

from amaranth import Value
from amaranth.sim import Simulator

PATIENT = 0.5
"""As in `sim.benches.stream`: with more pauses than this a reader waits for a beat before it is ready."""


def run_streams(dut, inputs, expected, *, start=None, tables=None, stall=0.0, seed=1, clocks=100_000):
    """Drive input streams with payloads and record all output streams.

    inputs : payloads as integers, of the stream "i", or {input stream: payloads}
    start : {input stream: clocks before its first beat}, 0 where it is not named
    tables : {write port: words as integers}, written one a clock; all inputs wait until they are
    expected : {output stream: number of beats}; each is watched for 64 more clocks
    stall : probability per clock that a stream pauses, or {stream: probability}; above a half an output is
        ready only once a beat waits
    Returns {stream: payloads} of the outputs, and {stream: clocks of the transfers}, also of the inputs.
    Raises AssertionError if an output gives fewer beats within `clocks` clocks.
    """
    inputs = inputs if isinstance(inputs, dict) else {"i": inputs}
    stalls = dict.fromkeys([*inputs, *expected], stall) if isinstance(stall, float | int) else stall
    payloads = {name: [] for name in expected}
    taken = {name: [] for name in [*inputs, *expected]}
    tables = tables or {}
    loaded = max((len(words) + 1 for words in tables.values()), default=0)

    def source(name):
        async def drive(ctx):
            i, rng = getattr(dut, name), random.Random(seed)
            clock = loaded + (start or {}).get(name, 0)
            for _ in range(clock):
                await ctx.tick()
            for payload in inputs[name]:
                while rng.random() < stalls[name]:
                    await ctx.tick()
                    clock += 1
                ctx.set(Value.cast(i.payload), payload)
                ctx.set(i.valid, 1)
                moved = False
                while not moved:
                    *_, moved = await ctx.tick().sample(i.ready)
                    clock += 1
                taken[name].append(clock - 1)
                ctx.set(i.valid, 0)

        return drive

    def sink(name, beats):
        async def take(ctx):
            o, rng, idle = getattr(dut, name), random.Random(f"{seed}{name}"), 0
            waits = False
            for clock in range(clocks):
                goes_on = rng.random() >= stalls[name]
                ctx.set(o.ready, goes_on and (stalls[name] <= PATIENT or waits))
                *_, ready, valid, payload = await ctx.tick().sample(o.ready, o.valid, Value.cast(o.payload))
                waits = valid and not ready
                if ready and valid:
                    payloads[name].append(payload)
                    taken[name].append(clock)
                idle = idle + 1 if len(payloads[name]) >= beats else 0
                if idle > 64:
                    ctx.set(o.ready, 1)
                    return
            raise AssertionError(
                f"hang: {len(payloads[name])} of {beats} beats of {name} after {clocks} clocks"
            )

        return take

    def writer(name):
        async def write(ctx):
            port = getattr(dut, name)
            for address, word in enumerate(tables[name]):
                ctx.set(port.en, 1)
                ctx.set(port.addr, address)
                ctx.set(port.data, word)
                await ctx.tick()
            ctx.set(port.en, 0)

        return write

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    for name in inputs:
        simulator.add_testbench(source(name))
    for name in tables:
        simulator.add_testbench(writer(name))
    for name, beats in expected.items():
        simulator.add_testbench(sink(name, beats))
    simulator.run()
    return payloads, taken
