# amaranth: UnusedElaboratable=no
import random

import pytest
from amaranth.sim import Simulator

from fastac.gateware.stream.frame_end import FrameEnd


@pytest.mark.parametrize("beats", [1, 2, 5, 8])
def test_the_last_beat_of_each_frame(beats):
    dut, rng = FrameEnd(beats), random.Random(1)

    async def bench(ctx):
        count = 0
        for _ in range(200):
            taken = rng.random() < 0.6
            ctx.set(dut.taken, taken)
            count += taken
            assert ctx.get(dut.done) == (taken and count % beats == 0)
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()


def test_invalid_arguments():
    with pytest.raises(ValueError, match="beats 0: expected at least 1"):
        FrameEnd(0)
