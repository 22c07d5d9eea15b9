# amaranth: UnusedElaboratable=no
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.target.elaboration import to_rtlil
from fastac.models.integer.network import Layer, Requantisation
from fastac.sim.check_stream import check, pack

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


def beats(layers, lanes, rng, count=100):
    """Feature vectors (beats, lanes, inputs): extremes in all lanes, in different lanes, then random."""
    inputs = layers[0].weight.shape[1]
    signs = np.sign(layers[0].weight)
    plain = np.array([0, 255, -255])[:, None].repeat(inputs, axis=1)
    extremes = np.concatenate([plain, 255 * signs, -255 * signs])
    x = [extremes.repeat(lanes, axis=0), np.tile(extremes, (lanes, 1))]
    return np.concatenate([*x, rng.integers(-255, 256, (count * lanes, inputs))]).reshape(-1, lanes, inputs)


def compare(dut, layers, x, latency, bits, folder):
    hidden = layers[0](x)
    assert (hidden == (1 << bits) - 1).any()
    assert len(np.unique(hidden)) > 60
    check(
        dut,
        "normal_mlp",
        folder,
        room=latency + 1,
        inputs=pack(x, WIDTH),
        expected=pack(reference(layers, x), layers[-1].accumulator_width),
        latencies=[(k, k, latency) for k in range(len(x))],
    )


SHAPES = [([6, 8, 5, 9, 3], 2, 51, 7), ([5, 4, 3], 4, 21, 10), ([5, 4, 4, 3], 1, 34, 7)]


@pytest.mark.parametrize(("sizes", "lanes", "latency", "bits"), SHAPES)
@pytest.mark.quick("sizes0-2-51-7")
def test_baked_weights(tmp_path, sizes, lanes, latency, bits):
    rng = np.random.default_rng(1)
    layers = network(sizes, rng, bits)
    dut = NormalMlp(layers, input_width=WIDTH, lanes=lanes)
    assert (dut.latency, dut.multipliers, dut.parameter_bits) == (latency, 0, 0)
    text = to_rtlil(dut)
    assert "cell $mul " not in text
    # The lanes share one module of each core, beside the three of the queue.
    assert text.count("\nmodule ") == 1 + len(dut.cores[0]) + 3
    compare(dut, layers, beats(layers, lanes, rng), latency, bits, tmp_path)


@pytest.mark.parametrize(("sizes", "lanes", "latency", "bits"), SHAPES)
@pytest.mark.quick("sizes2-1-34-7")
def test_loadable_weights(tmp_path, with_parameters, sizes, lanes, latency, bits):
    """Hardware built for one network computes another one that is loaded, on all lanes."""
    rng = np.random.default_rng(2)
    built = network(sizes, rng, bits, loadable=True)
    layers = network(sizes, rng, bits, loadable=True)
    dut = NormalMlp(built, input_width=WIDTH, lanes=lanes)
    assert dut.latency == latency
    # Hidden layers: one per pair of neurons and input, and one per neuron's scale. Last: one per weight.
    pairs = sum(-(-neurons // 2) * inputs + neurons for inputs, neurons in pairwise(sizes[:-1]))
    assert dut.multipliers == lanes * (pairs + 3 * sizes[-2])
    image = dut.parameter_image(layers)
    assert image != dut.parameter_image(built)
    assert image.bit_length() <= dut.parameter_bits
    x = beats(layers, lanes, rng)
    assert not np.array_equal(reference(layers, x), reference(built, x))
    compare(with_parameters(dut, image), layers, x, latency, bits, tmp_path)


@pytest.mark.full
def test_multipliers_of_the_papers_network():
    layers = network([6, 16, 16, 16, 3], np.random.default_rng(1), 10, loadable=True)
    dut = NormalMlp(layers, input_width=WIDTH, lanes=1)
    assert dut.multipliers == 48 + 128 + 128 + 48 + 48
    assert to_rtlil(dut).count("cell $mul ") == dut.multipliers
    assert NormalMlp(layers, input_width=WIDTH, lanes=4).multipliers == 4 * dut.multipliers


def test_invalid_arguments():
    layers = network([5, 4, 4, 3], np.random.default_rng(2))

    def refused(message, layers=layers, lanes=1):
        with pytest.raises(ValueError, match=message):
            NormalMlp(layers, input_width=WIDTH, lanes=lanes)

    scale = layers[0].requantisation
    short = Requantisation(scale.multiplier[:3], scale.shift)
    low = replace(layers[1], input_limit=np.full(4, 126))
    refused(r"lanes 3: expected one of \(1, 2, 4\)", lanes=3)
    refused(r"layers\[-1\] of 4 neurons: expected 3", layers[:2])
    refused(r"layers\[-1\] of 3 neurons: .* not requantised", [replace(layers[2], requantisation=short)])
    refused(r"layers\[0\].requantisation None", [replace(layers[0], requantisation=None), *layers[1:]])
    refused(
        r"layers\[0\].requantisation .*: expected one",
        [replace(layers[0], requantisation=short), *layers[1:]],
    )
    refused(r"layers\[1\] of 5 inputs: expected 4", [layers[0], *layers])
    refused(r"layers\[1\].input_limit 126: expected 127", [layers[0], low, layers[2]])


def test_parameters_that_do_not_fit():
    layers = network([5, 4, 4, 3], np.random.default_rng(2), loadable=True)
    dut = NormalMlp(layers, input_width=WIDTH, lanes=1)

    def refused(message, *changed, dut=dut):
        with pytest.raises(ValueError, match=message):
            dut.parameter_image(changed)

    refused("2 layers: expected 3", layers[0], layers[2])
    refused(
        r"weight \(5, 5\): expected \(4, 5\)",
        *network([5, 5, 4, 3], np.random.default_rng(3), loadable=True),
    )
    refused("bits 8: expected 7", *network([5, 4, 4, 3], np.random.default_rng(3), bits=8, loadable=True))
    mixed = replace(layers[1], loadable=False)
    refused(r"layers\[1\].loadable False: expected True, as the first", layers[0], mixed, layers[2])
    baked = network([5, 4, 4, 3], np.random.default_rng(2))
    refused("loadable False: expected True", *baked)
    refused("loadable False: expected True", *layers, dut=NormalMlp(baked, input_width=WIDTH, lanes=1))
