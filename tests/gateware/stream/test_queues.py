# amaranth: UnusedElaboratable=no
"""CreditQueue after a test pipeline, and BypassQueue, under Amaranth's own simulator."""

import random
from itertools import pairwise

import pytest
from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from fastac.gateware.stream.queues import BypassQueue, CreditQueue

BEATS = 300
SPREAD = 0x9E37
"""Odd factor that spreads the beats' numbers over all bits of the payload."""


class Pipeline(wiring.Component):
    """A counter whose values, times SPREAD, pass `registers` registers into a CreditQueue of `depth`."""

    def __init__(self, registers: int, depth: int):
        self.registers = registers
        self.queue = CreditQueue(unsigned(16), depth=depth)
        super().__init__({"wanted": In(1), "launch": Out(1), "o": Out(stream.Signature(unsigned(16)))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = self.queue
        count = Signal(16)
        valid = Signal(self.registers)
        words = [(count * SPREAD)[:16]] + [Signal(16, name=f"word_{k}") for k in range(self.registers)]
        m.d.comb += [
            self.launch.eq(self.wanted & queue.room),
            queue.launch.eq(self.launch),
            queue.i_valid.eq(valid[-1]),
            queue.i.eq(words[-1]),
        ]
        m.d.sync += [count.eq(count + self.launch), valid.eq(Cat(self.launch, valid))]
        m.d.sync += [after.eq(before) for before, after in pairwise(words)]
        wiring.connect(m, queue.o, wiring.flipped(self.o))
        return m


def run(registers, depth, rest, stall):
    """Returns the payload accepted in each clock (None: none), and the clocks in which beats entered.

    rest, stall : functions of the clock: probability that no beat enters, and that `o` is not ready
    """
    dut = Pipeline(registers, depth)
    taken, launches = [], []

    async def bench(ctx):
        rng = random.Random(1)
        offered, under_way = None, 0
        for clock in range(100 * BEATS):
            ctx.set(dut.wanted, rng.random() >= rest(clock))
            ctx.set(dut.o.ready, rng.random() >= stall(clock))
            launch, valid, ready, payload = (
                ctx.get(s) for s in (dut.launch, dut.o.valid, dut.o.ready, dut.o.payload)
            )
            assert launch == (ctx.get(dut.wanted) and under_way < depth), f"clock {clock}: a free credit"
            assert offered is None or (valid and payload == offered), f"clock {clock}: withdrew a beat"
            offered = payload if valid and not ready else None
            taken.append(payload if valid and ready else None)
            if launch:
                launches.append(clock)
            under_way += launch - (valid and ready)
            assert 0 <= under_way <= depth
            if len(taken) - taken.count(None) == BEATS:
                return
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return taken, launches


@pytest.mark.parametrize(("registers", "depth"), [(1, 2), (10, 16), (7, 8), (10, 4), (3, 1)])
@pytest.mark.parametrize("rest", [0, 0.5])
@pytest.mark.parametrize("stall", [0, 0.3, 0.9])
@pytest.mark.quick(
    "0-0-7-8", "0-0.5-10-16", "0.3-0-3-1", "0.3-0.5-1-2", "0.9-0-10-4", "0.9-0.5-7-8", "0.9-0-10-16"
)
def test_every_beat_leaves_once_and_in_order(registers, depth, rest, stall):
    taken, launches = run(registers, depth, lambda _: rest, lambda _: stall)
    assert [beat for beat in taken if beat is not None] == [n * SPREAD & 0xFFFF for n in range(BEATS)]
    if not stall:
        left = [clock for clock, beat in enumerate(taken) if beat is not None]
        assert [b - a for a, b in zip(launches, left, strict=False)] == [registers] * BEATS


@pytest.mark.parametrize("registers", [1, 7, 10, 11])
@pytest.mark.quick("7", "11")
def test_depth_of_sustains_one_beat_per_clock_after_a_stall(registers):
    depth = CreditQueue.depth_of(registers)
    stalled = range(20, 90)
    taken, launches = run(registers, depth, lambda _: 0, lambda clock: clock in stalled)
    # Pipeline and queue fill up during the stall; from its end on a beat leaves in every clock.
    assert launches[:20] == list(range(20))
    assert len([clock for clock in launches if clock in stalled]) == depth - registers
    assert None not in taken[stalled.stop :]
    assert len(taken) == stalled.stop + BEATS - (stalled.start - registers)


@pytest.mark.parametrize(("registers", "depth"), [(1, 2), (7, 8), (8, 16), (10, 16), (11, 16)])
def test_depth_of_a_pipeline(registers, depth):
    assert CreditQueue.depth_of(registers) == depth


def test_invalid_arguments():
    with pytest.raises(ValueError, match="depth 0: expected at least 1"):
        CreditQueue(unsigned(4), depth=0)


@pytest.mark.parametrize("depth", [1, 3, 8])
@pytest.mark.parametrize(("rest", "stall"), [(0.0, 0.0), (0.3, 0.6), (0.0, 0.5)])
def test_a_bypass_queue_costs_no_clock_and_loses_nothing(depth, rest, stall):
    dut, rng = BypassQueue(unsigned(16), depth=depth), random.Random(1)
    entered, left, most = [], [], 0

    async def bench(ctx):
        nonlocal most
        offered, word = False, 1
        for _ in range(1000):
            offered = offered or rng.random() >= rest
            ctx.set(dut.i.valid, offered)
            ctx.set(dut.i.payload, word * SPREAD & 0xFFFF if offered else 0)
            ctx.set(dut.o.ready, rng.random() >= stall)
            waiting = len(entered) - len(left)
            assert ctx.get(dut.o.valid) == (waiting > 0 or offered)
            assert ctx.get(dut.i.ready) == (waiting < depth)
            if ctx.get(dut.o.valid) and ctx.get(dut.o.ready):
                left.append(ctx.get(dut.o.payload))
            if offered and ctx.get(dut.i.ready):
                entered.append(word * SPREAD & 0xFFFF)
                offered, word = False, word + 1
            most = max(most, len(entered) - len(left))
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert left == entered[: len(left)]
    assert most == (depth if stall else 0)


def test_a_bypass_queue_needs_a_place():
    with pytest.raises(ValueError, match="depth 0: expected at least 1"):
        BypassQueue(unsigned(16), depth=0)
