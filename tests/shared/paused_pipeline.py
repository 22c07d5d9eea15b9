"""A pipeline with a clock enable `advance`, and no handshake, driven with pauses."""

from collections.abc import Callable, Sequence

import numpy as np
from amaranth.hdl import Fragment
from amaranth.sim import Simulator


def outputs(
    dut, platform, inputs: Sequence, drive: Callable, *, latency: int, pauses: np.ndarray
) -> list[int]:
    """What `dut.o` is for each of the inputs, `latency` clocks with `advance` high after it was given.

    drive(ctx, one) : sets the ports to one of the inputs
    pauses : by clock, whether `advance` is low; more clocks than the run takes
    """
    found = []

    async def bench(ctx):
        taken, clock = 0, 0
        while taken < len(inputs) + latency:
            drive(ctx, inputs[min(taken, len(inputs) - 1)])
            advance = not pauses[clock]
            ctx.set(dut.advance, advance)
            if advance and taken >= latency:
                found.append(ctx.get(dut.o))
            await ctx.tick()
            taken, clock = taken + advance, clock + 1

    simulator = Simulator(Fragment.get(dut, platform))
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return found
