# amaranth: UnusedElaboratable=no
import random

import numpy as np
from amaranth import Module, Signal
from amaranth.sim import Simulator

from fastac.gateware.bus.frame_timer import STAMP
from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import PLAIN, RECORD_BYTES, WITH_HALF_WIDTHS
from fastac.gateware.bus.result_registers import ResultRegisters, stamp_record


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
            found = np.frombuffer(octets, PLAIN.layout)[0]
            assert (found["frame"], found["time"], found["flags"]) == (number, time, 1 << 8 | bad)
            assert sum(int(found[name]) != 0 for name in found.dtype.names) == 2 + (time != 0)

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()


HALF_WIDTH_BITS = 37
LARGEST = (1 << HALF_WIDTH_BITS) - 1


def test_records_wait_for_half_widths_and_a_soft_reset_ends_that():
    """One record a result, a clock after its half-widths, or with the soft reset that they do not survive."""
    identity = Identity(
        bundle_hash=1,
        version=1,
        height=4,
        width=4,
        channels=3,
        lanes=1,
        axes="xz",
        force_width=40,
        half_width=True,
        half_width_bits=HALF_WIDTH_BITS,
        packets=True,
    )
    dut, rng = ResultRegisters(identity), random.Random(1)
    found, expected, shown = [], [], []

    async def bench(ctx):
        for number in range(1, 61):
            halves = [rng.choice([0, LARGEST, rng.getrandbits(HALF_WIDTH_BITS)]) for _ in "xz"]
            wait, cut = rng.randrange(1, 6), rng.choice([None, None, 0, 1, 5, 6])
            for clock in range(8):
                comes, cuts = clock == wait, clock == cut
                ctx.set(dut.result, clock == 0 and not cuts)
                if clock == 1:
                    ctx.set(dut.frame, number)
                    ctx.set(dut.sequence, number)
                # A reset of the datapath takes half-widths with it that come later.
                comes &= cut is None or not 0 <= cut < clock
                ctx.set(dut.half_widths_valid, comes)
                ctx.set(dut.half_widths.as_value(), halves[0] | halves[1] << HALF_WIDTH_BITS)
                ctx.set(dut.cut, cuts)
                *_, valid, record = await ctx.tick().sample(dut.record_valid, dut.record)
                if valid:
                    (one,) = np.frombuffer(record.to_bytes(WITH_HALF_WIDTHS.bytes, "little"), layout)
                    found.append((clock, *(int(one[name]) for name in names)))
                if comes:
                    shown.append((number, *halves))
            if cut != 0:
                lost = cut is not None and cut <= wait
                word = [LARGEST] * 2 if lost else halves
                expected.append((cut if lost else wait + 1, number, 0b1000 | 2 << 8, word[0], 0, word[1]))
            if shown:
                assert shown[-1] == (
                    ctx.get(dut.half_width_sequence),
                    ctx.get(dut.half_width_x),
                    ctx.get(dut.half_width_z),
                )

    layout, names = WITH_HALF_WIDTHS.layout, ("frame", "flags", *(f"half_width_{axis}" for axis in "xyz"))
    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert found == expected
