# amaranth: UnusedElaboratable=no
from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2
from fastac.gateware.mlp_mvm import MvmCore, MvmTile
from fastac.gateware.target.elaboration import to_rtlil
from fastac.models.integer.network import Layer
from fastac.sim.check_stream import check, pack


def vectors(layer, low, high, rng, count=100):
    """Inputs for the largest and smallest sum of every neuron, zero, the limits, then random inputs."""
    worst = np.where(layer.weight > 0, high, low), np.where(layer.weight > 0, low, high)
    plain = np.broadcast_to(0 * high, (1, len(high))), high[None], low[None]
    return np.concatenate([*worst, *plain, rng.integers(low, high + 1, (count, len(high)))])


def compare(dut, layer, x, folder):
    """Check every accumulator for the inputs `x`, its latency, and behaviour under back-pressure."""
    width = dut.core.input_width if hasattr(dut, "core") else dut.component.core.input_width
    latency = 5 + (layer.weight.shape[1] - 1).bit_length()
    check(
        dut,
        "mvm_tile",
        folder,
        room=latency + 1,
        inputs=pack(x, width),
        expected=pack(layer.accumulate(x), layer.accumulator_width),
        latencies=[(k, k, latency) for k in range(len(x))],
    )


def multiplications(core) -> int:
    return to_rtlil(core).count("cell $mul ")


@pytest.mark.parametrize(
    ("neurons", "inputs", "width", "input_signed"),
    [(3, 16, 7, False), (2, 11, 8, True), (1, 1, 3, False)],
)
@pytest.mark.quick("2-11-8-True")
def test_baked_weights(tmp_path, neurons, inputs, width, input_signed):
    rng = np.random.default_rng(1)
    weight = rng.integers(-128, 128, (neurons, inputs))
    # One neuron reaches the accumulator's bound exactly; another has weights of 0, powers of two, and
    # negative weights with the most signed digits.
    weight[0] = 127 if not input_signed else rng.choice([-128, 127], inputs)
    weight[-1, ::2] = 0
    weight[-1, 1::4] = -85
    weight[0, 0] = -64 if input_signed else 64
    bias = rng.integers(-(1 << 12), 1 << 12, neurons)
    bias[0] = 1 << 12
    high = (1 << (width - 1)) - 1 if input_signed else (1 << width) - 1
    # Different limits: widths follow each input's own limit.
    limit = np.maximum(high - 20 * np.arange(inputs), 3)
    layer = Layer(weight, bias, limit)
    dut = MvmTile(layer, input_width=width, input_signed=input_signed)
    assert (dut.core.multipliers, dut.core.parameter_bits) == (0, 0)
    assert multiplications(dut.core) == 0
    x = vectors(layer, -limit if input_signed else 0 * limit, limit, rng)
    assert np.abs(layer.accumulate(x)).max() == layer.accumulator_bound
    compare(dut, layer, x, tmp_path)


def test_baked_signs(tmp_path):
    """Sums of subtractions only, with and without a bias; neurons with zero weights; 12-bit weights."""
    weight = np.array([[-1, -5, -1365], [-2048, -1, -8], [-4, 0, 0], [0, 0, 0], [0, 0, 0], [683, -1023, 7]])
    layer = Layer(weight, np.array([0, 9, 0, 0, -5, 0]), np.full(3, 256), 12)
    x = vectors(layer, np.full(3, -256), np.full(3, 255), np.random.default_rng(2))
    assert np.abs(layer.accumulate(x)).max() == layer.accumulator_bound
    dut = MvmTile(layer, input_width=9, input_signed=True)
    assert multiplications(dut.core) == 0
    compare(dut, layer, x, tmp_path)


def extreme_layer(layer, rng):
    """The same shape with all weights and biases at their limits, so that both packed fields reach theirs."""
    neurons = len(layer.weight)
    weight = layer.weight_limit * rng.choice([-1, 1], layer.weight.shape)
    weight[0] = layer.weight_limit
    bias = layer.bias_limit * rng.choice([-1, 1], neurons)
    bias[0] = layer.bias_limit
    if neurons > 4:
        # Packed pairs of opposite signs, and pairs with zeros in the lower or the upper field.
        weight[1], weight[2], weight[3] = -weight[0], 0, weight[4]
        bias[2] = 0
    return replace(layer, weight=weight, bias=bias)


LOADABLE = {
    DSP48E2: [
        # Two neurons per multiplier, with and without a single one left; sums of 2, 8 and 16 packed products.
        (5, 16, 10, False, 8, 3),
        (4, 6, 9, True, 8, 2),
        (3, 16, 7, False, 8, 2),
        # A single input.
        (5, 1, 3, False, 8, 3),
        # Two products do not fit in one multiplier.
        (3, 5, 10, False, 12, 3),
    ],
    DSP48E1: [
        # Sums of 1, 2, 2 and 4 packed products.
        (5, 16, 9, False, 8, 3),
        (4, 6, 9, True, 8, 2),
        (3, 16, 10, False, 7, 2),
        (3, 16, 7, False, 8, 2),
        # Two products do not fit in one multiplier, though they would in a DSP48E2's.
        (3, 6, 10, False, 8, 3),
    ],
}


@pytest.mark.parametrize(
    ("dsp", "neurons", "inputs", "width", "input_signed", "bits", "units"),
    [(dsp, *case) for dsp, cases in LOADABLE.items() for case in cases],
    ids=lambda value: getattr(value, "name", str(value)),
)
@pytest.mark.quick(
    "DSP48E2-5-16-10-False-8-3",
    "DSP48E1-3-6-10-False-8-3",
    mutate=["DSP48E2-3-5-10-False-12-3", "DSP48E1-5-16-9-False-8-3"],
)
def test_loadable_weights(tmp_path, with_parameters, dsp, neurons, inputs, width, input_signed, bits, units):
    rng = np.random.default_rng(3)
    limit = np.full(inputs, (1 << (width - input_signed)) - 1)
    top = (1 << (bits - 1)) - 1
    largest = min(5000, top * int(limit.sum()))
    built = Layer(
        rng.integers(-top, top + 1, (neurons, inputs)),
        rng.integers(-largest, largest + 1, neurons),
        limit,
        bits,
        loadable=True,
    )
    low = -limit if input_signed else 0 * limit

    def tile():
        return MvmTile(built, input_width=width, input_signed=input_signed, dsp=dsp)

    assert tile().core.multipliers == units * inputs
    assert multiplications(tile().core) == units * inputs
    # Load other networks than the one that the hardware was built for.
    extreme = extreme_layer(built, rng)
    x = vectors(extreme, low, limit, rng)
    assert np.abs(extreme.accumulate(x)).max() == built.accumulator_bound
    networks = [extreme]
    if (inputs, bits) == (6, 8):
        networks += [built, replace(built, weight=0 * built.weight, bias=0 * built.bias)]
    for k, layer in enumerate(networks):
        dut = tile()
        image = dut.core.parameter_image(layer)
        assert image.bit_length() <= dut.core.parameter_bits
        compare(with_parameters(dut, image), layer, x, tmp_path / str(k))


def test_multipliers_of_the_papers_tiles():
    def multipliers(inputs, neurons, weight_bits, limit, signed, dsp=DSP48E2):
        weight, bias = np.zeros((neurons, inputs), int), np.zeros(neurons, int)
        layer = Layer(weight, bias, np.full(inputs, limit), weight_bits, loadable=True)
        core = MvmCore(layer, input_width=9 if signed else 10, input_signed=signed, dsp=dsp)
        return core.multipliers

    assert multipliers(6, 16, 8, 255, True) == 48
    assert multipliers(16, 16, 8, 1023, False) == 128
    assert multipliers(16, 3, 12, 1023, False) == 48
    # Two and one neuron.
    assert multipliers(16, 3, 8, 1023, False) == 32
    # On 25 × 18 bits the features' products still share slices, those of 10-bit activations only with 7-bit
    # weights, and those of 9-bit ones with 8-bit weights.
    assert multipliers(6, 16, 8, 255, True, DSP48E1) == 48
    assert multipliers(16, 16, 8, 1023, False, DSP48E1) == 256
    assert multipliers(16, 16, 7, 1023, False, DSP48E1) == 128
    assert multipliers(16, 16, 8, 511, False, DSP48E1) == 128


def test_latency_grows_with_the_logarithm_of_the_inputs():
    def latency(inputs, loadable):
        ones = np.ones((1, inputs), dtype=int)
        layer = Layer(ones, np.zeros(1, dtype=int), ones[0], loadable=loadable)
        return MvmTile(layer, input_width=4, input_signed=True).latency

    for loadable in (False, True):
        assert [latency(n, loadable) for n in (1, 2, 3, 6, 8, 16, 17)] == [5, 6, 7, 8, 8, 9, 10]


def test_invalid_arguments():
    layer = Layer(np.ones((2, 3), dtype=int), np.zeros(2, dtype=int), np.full(3, 100), loadable=True)
    core = MvmCore(layer, input_width=8, input_signed=True)
    baked = MvmCore(replace(layer, loadable=False), input_width=8, input_signed=True)

    def refused(message, core=core, **changes):
        with pytest.raises(ValueError, match=message):
            core.parameter_image(replace(layer, **changes))

    refused(r"loadable False: expected True", loadable=False)
    refused(r"loadable False: expected True", core=baked)
    refused(r"weight \(2, 4\): expected \(2, 3\)", weight=np.ones((2, 4), dtype=int))
    refused(r"weight_bits 9: expected 8", weight_bits=9)
    refused(r"input_limit \[99 99 99\]: expected \[100 100 100\]", input_limit=np.full(3, 99))
    for width, input_signed, largest in ((7, True, 64), (6, False, 63)):
        with pytest.raises(ValueError, match=f"input_limit 100: expected at most {largest}"):
            MvmTile(layer, input_width=width, input_signed=input_signed)
