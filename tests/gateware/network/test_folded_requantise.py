# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.network.folded_parameters import values_of
from fastac.gateware.network.folded_requantise import FoldedRequantise
from fastac.models.integer.network import Requantisation
from tests.gateware.network.test_requantise import TABLES, WIDTH, accumulators


def run(dut, scale, fold, loaded=()):
    """Simulate vectors that begin every `fold` clocks, after the columns' values are written."""
    a, streams = accumulators(scale), dut.neurons.streams
    vectors = a.reshape(len(a), -1, streams)
    clocks, found = vectors.shape[1], []

    async def bench(ctx):
        for k, value in enumerate(loaded):
            ctx.set(dut.write.en, 1 << (k // fold))
            ctx.set(dut.write.row, k % fold)
            ctx.set(dut.write.data, int(value) & ((1 << len(dut.write.data)) - 1))
            await ctx.tick()
        if len(loaded):
            ctx.set(dut.write.en, 0)
        for clock in range(len(vectors) * fold + 1 + dut.latency):
            ctx.set(dut.begins, clock % fold == 0)
            vector, part = divmod(clock - 1, fold)
            if clock and vector < len(vectors) and part < clocks:
                for k in range(streams):
                    ctx.set(dut.i[k], int(vectors[vector, part, k]))
            vector, part = divmod(clock - 1 - dut.latency, fold)
            if vector >= 0 and part < clocks:
                found.append([ctx.get(dut.o[k]) for k in range(streams)])
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()
    assert np.array_equal(np.array(found).reshape(a.shape), scale(a))


# By every amount of the second shift.
SHIFTS = [([65_537, 131_071, 99_999, 70_001], shift) for shift in (25, 18, 19, 20, 30)]


@pytest.mark.parametrize(("multipliers", "shift"), TABLES + SHIFTS)
def test_activations(multipliers, shift):
    """Baked, and loaded into hardware that was built with other multipliers and another shift."""
    scale = Requantisation(np.array(multipliers), shift)
    run(FoldedRequantise(scale, width=WIDTH, fold=4), scale, 4)
    built = FoldedRequantise(Requantisation(np.array([5, 6, 7, 8]), 5), width=WIDTH, fold=2, loadable=True)
    assert built.multipliers == 2
    loaded = FoldedRequantise(scale, width=WIDTH, fold=2, loadable=True)
    run(built, scale, 2, values_of(loaded.columns, 2).ravel())
