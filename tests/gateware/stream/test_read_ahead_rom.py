import numpy as np
import pytest
from amaranth import ClockDomain, Module
from amaranth.sim import Simulator

from fastac.gateware.stream import read_ahead_rom
from fastac.gateware.stream.read_ahead_rom import ReadAheadRom


@pytest.mark.parametrize(("depth", "bank_words"), [(1, 4), (2, 4), (5, 4), (8, 4), (11, 4), (11, 16)])
def test_words_in_order_whenever_they_are_taken(monkeypatch, depth, bank_words):
    """The word is there `latency` clocks after `take`, over several frames, with and without gaps."""
    monkeypatch.setattr(read_ahead_rom, "BANK_WORDS", bank_words)
    rng = np.random.default_rng(depth)
    table = rng.integers(-8, 8, (depth, 2, 3))
    dut = ReadAheadRom(table, 4)
    takes = np.concatenate([[0], rng.random(60) < 0.6, np.ones(20), np.zeros(dut.latency)]).astype(int)
    words = []

    async def bench(ctx):
        for take in takes:
            ctx.set(dut.take, int(take))
            word = [[ctx.get(field) for field in part] for part in dut.word]
            words.append(word)
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    found = [words[clock + dut.latency] for clock in np.flatnonzero(takes)]
    assert found == [table[beat % depth].tolist() for beat in range(len(found))]


def test_a_reset_begins_with_the_first_word():
    table = np.arange(1, 6)[:, None]
    dut = ReadAheadRom(table, 4)
    words = []

    async def bench(ctx):
        await ctx.tick()
        ctx.set(dut.take, 1)
        await ctx.tick().repeat(3)
        ctx.set(dut.take, 0)
        ctx.set(reset, 1)
        await ctx.tick()
        ctx.set(reset, 0)
        await ctx.tick()
        ctx.set(dut.take, 1)
        await ctx.tick().repeat(dut.latency)
        for _ in range(3):
            words.append(ctx.get(dut.word[0]))
            await ctx.tick()

    m = Module()
    m.domains.sync = domain = ClockDomain()
    m.submodules.dut = dut
    reset = domain.rst
    simulator = Simulator(m)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert words == [1, 2, 3]
