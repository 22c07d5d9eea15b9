# amaranth: UnusedElaboratable=no
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fastac.gateware.network.folded_network import FoldedMlp
from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.target.elaboration import to_rtlil
from fastac.models.integer.network import Layer, Requantisation
from fastac.sim.check_stream import check, pack
from fastac.sim.preloaded import PreloadedTable

WIDTH = 9


def network(sizes, rng, bits=7, loadable=False):
    """Layers of random weights, scaled so that activations use most of their range and some are clipped."""
    layers, limit = [], np.full(sizes[0], 255)
    for k, (inputs, neurons) in enumerate(pairwise(sizes)):
        # As in a trained network, the last layer's weights have more bits.
        weight_bits = 8 if k < len(sizes) - 2 else 12
        top = (1 << (weight_bits - 1)) - 1
        weight = rng.integers(-top, top + 1, (neurons, inputs))
        layer = Layer(weight, rng.integers(-900, 900, neurons), limit, weight_bits)
        reached = layer.accumulator_width
        layer = replace(layer, loadable=loadable)
        if k < len(sizes) - 2:
            shift = 17 + reached - bits - 3
            layer = replace(
                layer, requantisation=Requantisation(rng.integers(1 << 16, 1 << 17, neurons), shift, bits)
            )
        layers.append(layer)
        limit = np.full(neurons, (1 << bits) - 1)
    return layers


def reference(layers, x):
    for layer in layers:
        x = layer(x)
    return x


def beats(layers, rng, count=60):
    """Feature vectors (beats, inputs): all zero, all at their limits, the worst signs of each neuron, random."""
    inputs = layers[0].weight.shape[1]
    signs = np.sign(layers[0].weight)
    plain = np.array([0, 255, -255])[:, None].repeat(inputs, axis=1)
    return np.concatenate([plain, 255 * signs, -255 * signs, rng.integers(-255, 256, (count, inputs))])


def compare(dut, layers, x, bits, folder):
    hidden = layers[0](x)
    assert (hidden == (1 << bits) - 1).any()
    assert (hidden == 0).any()
    core = dut.component if isinstance(dut, PreloadedTable) else dut
    check(
        dut,
        "folded_mlp",
        folder,
        inputs=pack(x, WIDTH),
        expected=pack(reference(layers, x), layers[-1].accumulator_width),
        latencies=[(k, k, core.latency) for k in range(len(x))]
        + [(0, k, core.latency + k * core.interval) for k in range(len(x))],
    )


SHAPES = [([6, 8, 5, 9, 3], 2, 44, 7), ([5, 7, 4, 3], 4, 40, 10), ([6, 16, 3], 8, 30, 7), ([6, 16, 7, 3], 16, 50, 10)]


@pytest.mark.parametrize(("sizes", "fold", "latency", "bits"), SHAPES)
def test_baked_weights(tmp_path, sizes, fold, latency, bits):
    rng = np.random.default_rng(1)
    layers = network(sizes, rng, bits)
    dut = FoldedMlp(layers, input_width=WIDTH, fold=fold)
    compare(dut, layers, beats(layers, rng), bits, tmp_path)


@pytest.mark.parametrize(("sizes", "fold", "latency", "bits"), SHAPES)
def test_loadable_weights(tmp_path, sizes, fold, latency, bits):
    """Hardware built for one network computes another one that is loaded."""
    rng = np.random.default_rng(2)
    built = network(sizes, rng, bits, loadable=True)
    layers = network(sizes, rng, bits, loadable=True)
    dut = FoldedMlp(built, input_width=WIDTH, fold=fold)
    values = FoldedMlp(layers, input_width=WIDTH, fold=fold).table_values
    x = beats(layers, rng)
    assert not np.array_equal(reference(layers, x), reference(built, x))
    compare(PreloadedTable(dut, "parameters", values, dut.table.bits), layers, x, bits, tmp_path)
