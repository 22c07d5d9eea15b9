# amaranth: UnusedElaboratable=no
import random

import numpy as np
from amaranth import Module, Signal
from amaranth.sim import Simulator

from fastac.gateware.bus.record import RECORD_BYTES, record_layout
from fastac.gateware.packets.frame_stamps import FrameStamps, stamp_record


def test_stamps_of_frames_and_their_records():
    """Any times, repaired frames, and frames that a soft reset cuts and that get no number."""
    dut, rng = FrameStamps(), random.Random(1)
    m, record = Module(), Signal(8 * RECORD_BYTES)
    m.submodules.dut = dut
    m.d.comb += record.eq(stamp_record(dut.stamp))

    async def bench(ctx):
        number, first, started, accepted_at = 0, 0, False, 0
        for _ in range(600):
            time = rng.getrandbits(64)
            accepts, flush, bad = rng.random() < 0.5, rng.random() < 0.02, rng.getrandbits(1)
            begins = not started and rng.random() < 0.3
            ends = started and rng.random() < 0.2
            ctx.set(dut.time, time)
            for name, value in (("accepted", accepts), ("frame_started", begins), ("frame_done", ends)):
                ctx.set(getattr(dut, name), value)
            ctx.set(dut.frame_bad, bad)
            ctx.set(dut.flush, flush)
            # A frame starts with the beat that was accepted last.
            first = accepted_at if begins else first
            accepted_at = time if accepts else accepted_at
            started = (started or begins) and not ends and not flush
            await ctx.tick()
            if ends and not flush:
                number += 1
                assert [ctx.get(dut.stamp[k]) for k in ("number", "bad", "time")] == [number, bad, first]
                octets = ctx.get(record).to_bytes(RECORD_BYTES, "little")
                found = np.frombuffer(octets, record_layout())[0]
                assert (found["frame"], found["time"], found["flags"]) == (number, first, 1 << 8 | bad)
                assert sum(int(found[name]) != 0 for name in found.dtype.names) == 2 + (first != 0)
            assert ctx.get(dut.stamp.number) == number
        assert number > 30

    simulator = Simulator(m)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
