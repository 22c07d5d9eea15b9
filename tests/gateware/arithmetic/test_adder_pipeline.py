# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, Signal, signed
from amaranth.sim import Simulator

from fastac.gateware.arithmetic.adder_graph import AdderGraph, Operand, Range
from fastac.gateware.arithmetic.adder_pipeline import adder_pipeline, range_register, times
from fastac.gateware.arithmetic.adder_solver import adder_graph

INPUTS = [Range(0, 1023), Range(-64, 63), Range(-5, 0), Range(0, 0)]
MATRIX = np.array(
    [[85, -127, 3, 9], [0, 0, 0, 0], [-85, 127, 0, 0], [64, 0, 0, 0], [-1, -1, -1, 1], [1000, 77, 1, 0]]
)


def simulated(m: Module, bench) -> None:
    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize("latency", [5, 8])
def test_products_at_the_ends_of_every_nodes_range(latency):
    """Each node's lowest and highest value in turn, one vector a clock."""
    m = Module()
    x = [Signal(signed(12), name=f"x{j}") for j in range(len(INPUTS))]
    graph = adder_graph(MATRIX, INPUTS, latency)
    found = adder_pipeline(m, graph, list(zip(x, INPUTS, strict=True)), latency, "sum")
    low, high = (np.array([getattr(held, end) for held in INPUTS]) for end in ("low", "high"))
    rows = np.array(graph.coefficients)
    ends = np.where(rows > 0, high, low), np.where(rows > 0, low, high)
    inside = np.random.default_rng(1).integers(low, high + 1, (20, len(INPUTS)))
    vectors = np.concatenate([*ends, [low, high, 0 * low], inside])
    wrong = []

    async def bench(ctx):
        for k in range(len(vectors) + latency):
            if k >= latency:
                for row, output in zip(MATRIX, found, strict=True):
                    value = 0
                    if output is not None:
                        value = (ctx.get(output.value) << output.shift) * (-1 if output.negative else 1)
                        assert abs(value) <= output.bound
                    if value != row @ vectors[k - latency]:
                        wrong.append((k, row.tolist(), value))
            for signal, value in zip(x, vectors[min(k, len(vectors) - 1)].tolist(), strict=True):
                ctx.set(signal, value)
            await ctx.tick()

    simulated(m, bench)
    assert found[1] is None
    assert wrong == []


def test_registers_have_the_bits_of_their_ranges():
    m, value = Module(), Signal(signed(8))
    for held, shape in (
        (Range(0, 5), "unsigned(3)"),
        (Range(-1, 5), "signed(4)"),
        (Range(0, 0), "unsigned(1)"),
    ):
        signal = range_register(m, value, held, "held")
        assert repr(signal.shape()) == shape
        assert signal.reset_less


class TestTimes:
    GRAPH = AdderGraph(
        2,
        ((Operand(0), Operand(1, 1)), (Operand(2), Operand(0, 3)), (Operand(0), Operand(0, 2))),
        (Operand(3), Operand(4)),
    )

    def test_operands_come_first_and_outputs_last(self):
        for latency in (2, 3, 6):
            found = times(self.GRAPH, [4, 4, 6, 8, 7], latency)
            assert found[:2] == [0, 0]
            for k, pair in enumerate(self.GRAPH.additions):
                assert all(found[operand.node] < found[2 + k] <= latency for operand in pair)

    def test_narrow_values_wait(self):
        """Inputs of 4 bits wait in place of sums; a sum of fewer bits than its two operands waits itself."""
        assert times(self.GRAPH, [4, 4, 9, 10, 7], 5) == [0, 0, 4, 5, 5]
        single = AdderGraph(2, ((Operand(0), Operand(1)),), (Operand(2),))
        assert times(single, [8, 8, 9], 4)[2] == 1
        assert times(single, [8, 8, 20], 4)[2] == 4

    def test_too_short_a_latency(self):
        with pytest.raises(ValueError, match="latency 1: expected at least 2, the depth of the graph"):
            times(self.GRAPH, [4, 4, 6, 8, 7], 1)
