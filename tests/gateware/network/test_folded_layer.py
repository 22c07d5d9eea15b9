# amaranth: UnusedElaboratable=no
from dataclasses import replace

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.network.fold_plan import Series
from fastac.gateware.network.folded_layer import FoldedLayer
from fastac.gateware.network.folded_output import FoldedOutput
from fastac.gateware.network.folded_parameters import values_of
from fastac.models.integer.network import Layer


def layer_of(neurons, inputs, limit, rng, loadable):
    """Random weights and biases, those of neuron 0 at their limits."""
    weight = rng.integers(-127, 128, (neurons, inputs))
    weight[0] = 127 * rng.choice([-1, 1], inputs)
    layer = Layer(weight, rng.integers(-9000, 9000, neurons), np.full(inputs, limit), loadable=loadable)
    bias = layer.bias.copy()
    bias[0] = layer.bias_limit
    return replace(layer, bias=bias)


def vectors(layer, lowest, rng):
    """All zero, all at a limit, the worst signs of neuron 0, and random inputs."""
    top, inputs = layer.input_limit[0], layer.weight.shape[1]
    corners = [np.zeros(inputs), np.full(inputs, top), np.full(inputs, lowest)]
    worst = np.where(layer.weight[0] > 0, top, lowest)
    return np.vstack([*corners, worst, rng.integers(lowest, top + 1, (30, inputs))]).astype(int)


def outputs_of(dut, layer):
    """(clocks after the first outputs, wire, neuron) of all neurons."""
    neurons = range(len(layer.weight))
    if isinstance(dut, FoldedOutput):
        return [(0, k, k) for k in neurons]
    return [(*divmod(k, dut.leaving.streams), k) for k in neurons]


def run(dut, layer, x, loaded=()):
    """Simulate vectors that begin after `fold` clocks or a few more."""
    rng, fold = np.random.default_rng(5), dut.fold
    starts = 2 + np.cumsum(fold + np.arange(len(x)) % 4 // 2)
    inputs, expected = {}, {}
    for start, values, sums in zip(starts.tolist(), x.tolist(), layer.accumulate(x).tolist(), strict=True):
        if getattr(dut, "parallel", False):
            inputs |= {start + k: dict(enumerate(values)) for k in range(fold)}
        else:
            for j, value in enumerate(values):
                clock, stream = divmod(j, dut.arriving.streams)
                inputs.setdefault(start + clock, {})[stream] = value
        for clock, wire, neuron in outputs_of(dut, layer):
            expected.setdefault(start + dut.latency + clock, {})[wire] = sums[neuron]

    async def bench(ctx):
        for k, value in enumerate(loaded):
            ctx.set(dut.write.en, 1 << (k // fold))
            ctx.set(dut.write.row, k % fold)
            ctx.set(dut.write.data, int(value) & ((1 << len(dut.write.data)) - 1))
            await ctx.tick()
        if len(loaded):
            ctx.set(dut.write.en, 0)
        for clock in range(max(expected) + 1):
            begins = [clock + 1 - k in starts for k in range(len(dut.begins))]
            ctx.set(dut.begins, sum(begin << k for k, begin in enumerate(begins)))
            for wire, x in enumerate(dut.i):
                noise = int(rng.integers(0, 2))  # nobody may look at what is on an empty wire
                ctx.set(x, inputs.get(clock, {}).get(wire, noise))
            for wire, value in expected.get(clock, {}).items():
                assert ctx.get(dut.o[wire]) == value, f"clock {clock}, wire {wire}"
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()


def both(make, neurons, inputs, limit, lowest, latency, multipliers):
    """Compare baked weights, and weights loaded into hardware that was built with others."""
    rng = np.random.default_rng(1)
    baked = layer_of(neurons, inputs, limit, rng, loadable=False)
    dut = make(baked)
    assert (dut.latency, dut.multipliers) == (latency, multipliers)
    assert (Series(inputs, dut.fold).sum_latency, dut.multipliers_of(inputs, neurons, dut.fold)) == (
        latency,
        multipliers,
    )
    run(dut, baked, vectors(baked, lowest, rng))
    built, layer = (layer_of(neurons, inputs, limit, rng, loadable=True) for _ in range(2))
    dut = make(built)
    run(dut, layer, vectors(layer, lowest, rng), values_of(make(layer).columns, dut.fold).ravel())


SIZES = [(7, 5, 4, 3 + 2 + 1, 2 * 5), (3, 4, 16, 4 + 2, 4), (5, 7, 2, 2 + 2 + 2, 3 * 7)]


@pytest.mark.parametrize(("neurons", "inputs", "fold", "latency", "multipliers"), SIZES)
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.quick("True-7-5-4-6-10", "False-3-4-16-6-4")
def test_hidden_layer(neurons, inputs, fold, latency, multipliers, parallel):
    def make(layer):
        width = 9 if parallel else 7
        return FoldedLayer(layer, input_width=width, input_signed=parallel, fold=fold, parallel=parallel)

    limit, lowest = (255, -255) if parallel else (127, 0)
    both(make, neurons, inputs, limit, lowest, latency, multipliers)
