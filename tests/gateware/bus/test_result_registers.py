import random

import numpy as np
from amaranth import Module, Signal
from amaranth.sim import Simulator

from fastac.gateware.bus.frame_timer import STAMP
from fastac.gateware.bus.record import RECORD_BYTES, record_layout
from fastac.gateware.bus.result_registers import stamp_record


def test_the_record_of_a_frame_of_which_only_the_stamp_is_known():
    """Number, time, mark and format, and nothing else."""
    m, rng = Module(), random.Random(1)
    stamp, record = Signal(STAMP), Signal(8 * RECORD_BYTES)
    m.d.comb += record.eq(stamp_record(stamp))

    async def bench(ctx):
        for bits in (1, 8, 31, 32, 33, 63, 64, 64):
            number, bad, time = rng.getrandbits(32) | 1, rng.getrandbits(1), rng.getrandbits(bits)
            ctx.set(stamp.as_value(), number | bad << 32 | time << 33)
            await ctx.delay(1e-9)
            octets = ctx.get(record).to_bytes(RECORD_BYTES, "little")
            found = np.frombuffer(octets, record_layout())[0]
            assert (found["frame"], found["time"], found["flags"]) == (number, time, 1 << 8 | bad)
            assert sum(int(found[name]) != 0 for name in found.dtype.names) == 2 + (time != 0)

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()
