# amaranth: UnusedElaboratable=no
import random

import pytest
from amaranth.sim import Simulator

from fastac.gateware.packets.record_beats import RecordBeats


@pytest.mark.parametrize("octets", [1, 4, 8, 16])
@pytest.mark.parametrize(("rest", "stall"), [(0, 0), (0.4, 0.4)])
def test_records_leave_first_bytes_first(octets, rest, stall):
    """Also in a beat that is larger than a record, and after records that were dropped."""
    dut, rng = RecordBeats(octets, record_octets=8), random.Random(1)
    beats = -(-8 // octets)
    found, wanted, entered_at, left_at = [], [], [], []

    async def bench(ctx):
        offered, record = False, 0
        for clock in range(500):
            offered = offered or rng.random() >= rest
            record = record or rng.getrandbits(64)
            ctx.set(dut.i.valid, offered)
            ctx.set(dut.i.payload, record)
            ctx.set(dut.o.ready, rng.random() >= stall)
            drop = not ctx.get(dut.o.ready) and rng.random() < 0.1
            ctx.set(dut.drop, drop)
            if ctx.get(dut.o.valid) and ctx.get(dut.o.ready):
                found.append((ctx.get(dut.o.payload.bytes), ctx.get(dut.o.payload.last)))
                left_at.append(clock)
            taken = offered and ctx.get(dut.i.ready)
            if drop:
                del wanted[len(found) // beats :]
                del found[len(wanted) * beats :]
                del entered_at[len(wanted) :]
            elif taken:
                wanted.append(record)
                entered_at.append(clock)
            if taken:
                offered, record = False, 0
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    mask = (1 << 8 * octets) - 1
    stated = [(r >> 8 * octets * k & mask, int(k == beats - 1)) for r in wanted for k in range(beats)]
    assert found == stated[: len(found)]
    assert len(wanted) > 20
    if not rest and not stall:
        assert entered_at[:3] == [k * (beats + dut.latency) for k in range(3)]
        assert left_at[:beats] == list(range(dut.latency, beats + dut.latency))
