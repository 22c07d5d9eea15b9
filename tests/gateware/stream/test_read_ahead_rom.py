import numpy as np
import pytest
from amaranth import ClockDomain, Module
from amaranth.sim import Simulator

from fastac.gateware.stream.read_ahead_rom import QUEUE_WORDS, ReadAheadRom


@pytest.mark.parametrize(("depth", "bank_words"), [(11, 4), (8, 4), (5, 4), (2, 4), (1, 4), (11, 16)])
def test_words_in_order_whenever_they_are_taken(depth, bank_words):
    """The word is there `latency` clocks after `take`, over several frames, with gaps and without."""
    rng = np.random.default_rng(depth)
    table = rng.integers(-8, 8, (depth, 2, 3))
    table[1::2] = ~table[: depth // 2 * 2 : 2]  # each bit is 0 and 1 in each bank
    dut = ReadAheadRom(table, 4, bank_words=bank_words)
    start, wait, end = np.zeros(dut.start), np.zeros(2 * QUEUE_WORDS), np.zeros(dut.latency)
    some, each = rng.random(60) < 0.6, np.ones(40)
    takes = np.concatenate([start, each, some, wait, each, wait, some, end]).astype(int)
    words, ready = [], []

    async def bench(ctx):
        for take in takes:
            ctx.set(dut.take, int(take))
            words.append([[ctx.get(field) for field in part] for part in dut.word])
            ready.append(ctx.get(dut.ready))
            await ctx.tick()

    simulate(dut, bench)
    assert ready == [int(clock >= dut.start) for clock in range(len(takes))]
    found = [words[clock + dut.latency] for clock in np.flatnonzero(takes)]
    assert found == [table[beat % depth].tolist() for beat in range(len(found))]


@pytest.mark.parametrize("taken", [1, 3, 20])
def test_a_reset_begins_with_the_first_word(taken):
    """Also if it comes while words wait, and while others are under way."""
    table = np.arange(1, 6)[:, None]
    dut = ReadAheadRom(table, 4)
    words = []

    async def bench(ctx):
        await ctx.tick().repeat(dut.start)
        ctx.set(dut.take, 1)
        await ctx.tick().repeat(taken)
        ctx.set(dut.take, 0)
        ctx.set(reset, 1)
        await ctx.tick()
        ctx.set(reset, 0)
        await ctx.tick().repeat(dut.start)
        assert ctx.get(dut.ready)
        ctx.set(dut.take, 1)
        await ctx.tick().repeat(dut.latency)
        for _ in range(3):
            words.append(ctx.get(dut.word[0]))
            await ctx.tick()

    m = Module()
    m.domains.sync = domain = ClockDomain()
    m.submodules.dut = dut
    reset = domain.rst
    simulate(m, bench)
    assert words == [1, 2, 3]


def simulate(dut, bench) -> None:
    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
