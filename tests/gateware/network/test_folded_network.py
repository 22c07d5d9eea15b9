# amaranth: UnusedElaboratable=no
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.network.folded_network import FoldedMlp
from fastac.gateware.target.elaboration import to_rtlil
from fastac.models.integer.network import Layer, Requantisation
from fastac.sim.check_stream import check, pack
from fastac.sim.preloaded import PreloadedTable
from tests.gateware.network.test_pixel_network import WIDTH, beats, network, reference

# Sizes, fold, latency, multipliers, bits: vectors that fill their streams in each clock, and others.
SHAPES = [
    ([6, 8, 5, 9, 3], 2, 41, 24 + 24 + 25 + 15 + 4 + 3 + 5, 7),
    ([5, 7, 4, 3], 4, 30, 10 + 7 + 3 + 2 + 1, 10),
    ([6, 16, 3], 8, 25, 12 + 6 + 2, 7),
    ([6, 16, 7, 3], 16, 46, 6 + 16 + 3 + 1 + 1, 10),
]


def compare(dut, layers, bits, folder):
    """All zero, all at their limits, the signs that are worst for each neuron, and random features."""
    x = beats(layers, 1, np.random.default_rng(3), count=60)
    hidden = layers[0](x)
    assert (hidden == (1 << bits) - 1).any()
    assert (hidden == 0).any()
    core = getattr(dut, "component", dut)
    check(
        dut,
        "folded_mlp",
        folder,
        inputs=pack(x, WIDTH),
        expected=pack(reference(layers, x), layers[-1].accumulator_width),
        latencies=[
            *((k, k, core.latency) for k in range(len(x))),
            *((0, k, core.latency + k * core.interval) for k in range(len(x))),
        ],
        places=(1, core.latency // core.fold),
    )


@pytest.mark.parametrize(("sizes", "fold", "latency", "multipliers", "bits"), SHAPES)
@pytest.mark.quick("sizes2-8-25-20-7", mutate=["sizes0-2-41-100-7"])
def test_baked_weights(tmp_path, sizes, fold, latency, multipliers, bits):
    layers = network(sizes, np.random.default_rng(1), bits)
    dut = FoldedMlp(layers, input_width=WIDTH, fold=fold)
    assert (dut.latency, dut.multipliers, dut.interval) == (latency, multipliers, fold)
    assert "parameters" not in dut.signature.members
    compare(dut, layers, bits, tmp_path)


@pytest.mark.parametrize(("sizes", "fold", "latency", "multipliers", "bits"), SHAPES)
@pytest.mark.quick("sizes1-4-30-23-10", mutate=["sizes3-16-46-27-10"])
def test_loadable_weights(tmp_path, sizes, fold, latency, multipliers, bits):
    """Hardware built for one network computes another one that is loaded."""
    rng = np.random.default_rng(2)
    built = network(sizes, rng, bits, loadable=True)
    layers = network(sizes, rng, bits, loadable=True)
    dut, other = (FoldedMlp(each, input_width=WIDTH, fold=fold) for each in (built, layers))
    assert (dut.latency, dut.multipliers) == (latency, multipliers)
    assert dut.table == other.table
    values = other.table_values
    assert values.shape == (dut.table.depth, dut.table.fields)
    assert -(1 << (dut.table.bits - 1)) <= values.min() <= values.max() < 1 << (dut.table.bits - 1)
    assert not np.array_equal(values, dut.table_values)
    compare(PreloadedTable(dut, "parameters", values, dut.table.bits), layers, bits, tmp_path)


@pytest.mark.parametrize("loadable", [False, True])
@pytest.mark.quick("True")
def test_sums_reach_their_bounds(tmp_path, loadable):
    """Weights, biases and inputs at their limits, with the signs that add up."""
    rng, signs = np.random.default_rng(4), np.array([1, -1, 1, -1])

    def extreme(bits, limit, signs, requantisation=None):
        # Only baked weights reach the lowest word.
        lowest = -(1 << (bits - 1)) + loadable
        weight = np.where(signs[:, None] > 0, -lowest - 1 + loadable, np.full((1, len(limit)), lowest))
        bias = signs * ((1 << (bits - 1)) - 1) * int(limit.sum())
        return Layer(weight, bias, limit, bits, requantisation, loadable)

    scale = Requantisation(np.array([131_071, 1, 2, 3]), 24)
    layers = [extreme(8, np.full(3, 255), signs, scale), extreme(12, np.full(4, 127), signs[:3])]
    # All activations at their limit: what the last layer sums is as large as it can be.
    upwards = replace(layers[0], weight=np.full((4, 3), 127), bias=abs(layers[0].bias))
    most = [upwards, layers[1]]
    x = np.concatenate([np.array([[0] * 3, [255] * 3, [-255] * 3]), rng.choice([-255, 255], (20, 3))])
    sums = layers[0].accumulate(x)
    assert abs(sums).max() == layers[0].accumulator_bound
    for name, chosen in (("first", layers), ("last", most)):
        dut = FoldedMlp(chosen, input_width=WIDTH, fold=2)
        expected = pack(reference(chosen, x), chosen[-1].accumulator_width)
        check(dut, name, tmp_path / name, inputs=pack(x, WIDTH), expected=expected, stalls=(0,))


@pytest.mark.parametrize("fold", [2, 4, 8, 16])
@pytest.mark.quick("16")
def test_formulas_of_the_papers_network(fold):
    sizes = [6, 16, 16, 16, 3]
    dut = FoldedMlp(network(sizes, np.random.default_rng(1), 10), input_width=WIDTH, fold=fold)
    assert FoldedMlp.latency_of(sizes[:-1], fold) == dut.latency
    products = 96 + 256 + 256 + 48 + 3 * 16
    assert FoldedMlp.multipliers_of(sizes, fold) == dut.multipliers == products // fold
    assert to_rtlil(dut).count("cell $mul ") == dut.multipliers


def test_invalid_arguments():
    layers = network([5, 4, 4, 3], np.random.default_rng(2))
    with pytest.raises(ValueError, match=r"fold 3: expected one of \(2, 4, 8, 16\)"):
        FoldedMlp(layers, input_width=WIDTH, fold=3)
    with pytest.raises(ValueError, match=r"layers\[-1\] of 4 neurons: expected 3"):
        FoldedMlp(layers[:2], input_width=WIDTH, fold=2)
    with pytest.raises(ValueError, match="input_limit 255: expected at most 128"):
        FoldedMlp(layers, input_width=8, fold=2)
