# amaranth: UnusedElaboratable=no
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gateware.normal_mlp import NormalMlp
from models.integer import Layer, Requantisation
from sim.stream import check, pack

WIDTH = 9


def network(sizes, rng, bits=7):
    """Layers of random weights; the requantisations use most of the activations' range and clip some."""
    layers, limit = [], np.full(sizes[0], 255)
    for k, (inputs, neurons) in enumerate(pairwise(sizes)):
        layer = Layer(rng.integers(-127, 128, (neurons, inputs)), rng.integers(-900, 900, neurons), limit)
        if k < len(sizes) - 2:
            shift = 17 + layer.accumulator_width - bits - 2
            layer = replace(
                layer, requantisation=Requantisation(rng.integers(1 << 16, 1 << 17, neurons), shift)
            )
        layers.append(layer)
        limit = np.full(neurons, (1 << bits) - 1)
    return layers


def reference(layers, x):
    for layer in layers:
        x = layer(x)
    return x


@pytest.mark.parametrize(
    ("sizes", "lanes", "latency"),
    [([6, 8, 5, 9, 3], 2, 26), ([5, 4, 3], 4, 10), ([5, 4, 4, 3], 1, 16)],
)
def test_rtl_equals_reference(tmp_path, sizes, lanes, latency):
    rng = np.random.default_rng(1)
    layers = network(sizes, rng)
    dut = NormalMlp(layers, input_width=WIDTH, lanes=lanes)
    assert dut.latency == latency
    signs = np.sign(layers[0].weight)
    plain = np.array([0, 255, -255])[:, None].repeat(sizes[0], axis=1)
    extremes = np.concatenate([plain, 255 * signs, -255 * signs])
    # The extremes in all lanes at once, then in different lanes, then anything.
    x = [extremes.repeat(lanes, axis=0), np.tile(extremes, (lanes, 1))]
    x = np.concatenate([*x, rng.integers(-255, 256, (150 * lanes, sizes[0]))]).reshape(-1, lanes, sizes[0])
    hidden = layers[0](x)
    assert (hidden == 127).any()
    assert len(np.unique(hidden)) > 60
    normals = reference(layers, x)
    check(
        dut,
        "normal_mlp",
        tmp_path,
        inputs=pack(x, WIDTH),
        expected=pack(normals, layers[-1].accumulator_width),
        latencies=[(k, k, latency) for k in range(len(x))],
    )


def test_refusals():
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
