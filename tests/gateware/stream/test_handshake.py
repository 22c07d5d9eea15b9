# amaranth: UnusedElaboratable=no
"""The handshakes of pipelines, clock by clock, under Amaranth's own simulator."""

import random
from itertools import pairwise

import pytest
from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from fastac.gateware.stream.handshake import check_lanes, credit_handshake, pipeline_handshake

CLOCKS = 400


class Pipeline(wiring.Component):
    """Bytes through `latency` registers."""

    def __init__(self, latency: int):
        self.latency = latency
        super().__init__(
            {"i": In(stream.Signature(unsigned(8))), "o": Out(stream.Signature(unsigned(8)))},
        )

    def elaborate(self, platform):
        m = Module()
        advance = pipeline_handshake(m, self.i, self.o, self.latency)
        words = [self.i.payload] + [Signal(8, name=f"word_{k}") for k in range(self.latency)]
        with m.If(advance):
            m.d.sync += [after.eq(before) for before, after in pairwise(words)]
        m.d.comb += self.o.payload.eq(words[-1])
        return m


@pytest.mark.parametrize("latency", [1, 4])
@pytest.mark.parametrize(("rest", "stall"), [(0, 0), (0.5, 0.5), (0.9, 0.9)])
def test_only_a_waiting_output_stalls_the_pipeline(latency, rest, stall):
    """The registers move in every clock in which the output is taken or empty, and in no other."""
    dut = Pipeline(latency)

    async def bench(ctx):
        rng = random.Random(5)
        registers, offered = [None] * latency, None  # None: no beat
        for _ in range(CLOCKS):
            if offered is None and rng.random() >= rest:
                offered = rng.getrandbits(8)
            ready = rng.random() >= stall
            ctx.set(dut.i.valid, offered is not None)
            ctx.set(dut.i.payload, offered or 0)
            ctx.set(dut.o.ready, ready)
            moves = ready or registers[-1] is None
            assert ctx.get(dut.i.ready) == moves
            assert ctx.get(dut.o.valid) == (registers[-1] is not None)
            assert registers[-1] in (None, ctx.get(dut.o.payload))
            await ctx.tick()
            if moves:
                registers, offered = [offered, *registers[:-1]], None

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


class FreePipeline(wiring.Component):
    """Bytes, and beside them whether they are odd, through `latency` registers without clock enables."""

    def __init__(self, latency: int, fold: int):
        self.latency, self.fold = latency, fold
        super().__init__(
            {
                "i": In(stream.Signature(unsigned(8))),
                "o": Out(stream.Signature(unsigned(8))),
                "odd": Out(1),
                "ago": Out(latency + 1),
            },
        )

    def elaborate(self, platform):
        m = Module()
        last, ago = credit_handshake(m, self.i, self.o, self.latency, fold=self.fold, flags=self.odd)
        words = [self.i.payload] + [Signal(8, name=f"word_{k}") for k in range(self.latency)]
        m.d.sync += [after.eq(before) for before, after in pairwise(words)]
        m.d.comb += [last.payload.eq(words[-1]), last.flags.eq(words[-1][0]), self.ago.eq(Cat(ago))]
        return m


@pytest.mark.parametrize(("latency", "fold"), [(1, 1), (4, 1), (9, 4)])
@pytest.mark.parametrize(("rest", "stall"), [(0, 0), (0.5, 0.5), (0.1, 0.9)])
def test_beats_wait_behind_a_pipeline_that_never_stalls(latency, fold, rest, stall):
    """A beat is offered `latency` clocks after it entered or as soon as those before it have left; one enters
    every `fold` clocks while fewer than latency // fold + 1 are inside."""
    dut = FreePipeline(latency, fold)
    depth = latency // fold + 1

    async def bench(ctx):
        rng = random.Random(5)
        inside, entered, offered = [], [], None  # (word, clock in which it entered), oldest first
        for clock in range(CLOCKS):
            if offered is None and rng.random() >= rest:
                offered = rng.getrandbits(8)
            ready = rng.random() >= stall
            ctx.set(dut.i.valid, offered is not None)
            ctx.set(dut.i.payload, offered or 0)
            ctx.set(dut.o.ready, ready)
            takes = len(inside) < depth and clock - (entered[-1] if entered else -fold) >= fold
            assert ctx.get(dut.i.ready) == takes
            there = bool(inside) and clock >= inside[0][1] + latency
            assert ctx.get(dut.o.valid) == there
            if there:
                assert (ctx.get(dut.o.payload), ctx.get(dut.odd)) == (inside[0][0], inside[0][0] & 1)
            if takes and offered is not None:
                entered.append(clock)
            assert ctx.get(dut.ago) == sum((clock - k in entered) << k for k in range(latency + 1))
            await ctx.tick()
            if there and ready:
                inside.pop(0)
            if takes and offered is not None:
                inside.append((offered, clock))
                offered = None
        if not rest and not stall:
            assert len(entered) == -(-CLOCKS // fold), "the highest rate"

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize("lanes", [0, 3, 8])
def test_numbers_of_lanes(lanes):
    with pytest.raises(ValueError, match=f"lanes {lanes}: expected one of"):
        check_lanes(lanes)
