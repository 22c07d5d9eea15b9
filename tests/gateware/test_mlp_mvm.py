# amaranth: UnusedElaboratable=no
import numpy as np
import pytest

from gateware.mlp_mvm import MvmTile
from models.integer import Layer
from sim.stream import check, pack


def vectors(layer, low, high, rng, count=200):
    """Inputs that drive every neuron to its largest and smallest sum, zero, the limits, then anything."""
    worst = np.where(layer.weight > 0, high, low), np.where(layer.weight > 0, low, high)
    plain = np.broadcast_to(0 * high, (1, len(high))), high[None], low[None]
    return np.concatenate([*worst, *plain, rng.integers(low, high + 1, (count, len(high)))])


@pytest.mark.parametrize(
    ("neurons", "inputs", "group", "width", "input_signed", "latency"),
    [(3, 16, 4, 7, False, 5), (2, 11, 3, 8, True, 5), (2, 3, 4, 9, True, 3)],
)
def test_rtl_equals_reference(tmp_path, neurons, inputs, group, width, input_signed, latency):
    rng = np.random.default_rng(1)
    weight = rng.integers(-128, 128, (neurons, inputs))
    # One neuron reaches the accumulator's bound exactly; some weights of another are 0.
    weight[0] = 127 if not input_signed else rng.choice([-128, 127], inputs)
    weight[1, ::2] = 0
    bias = rng.integers(-(1 << 12), 1 << 12, neurons)
    bias[0] = 1 << 12
    low, high = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if input_signed else (0, (1 << width) - 1)
    # Limits that differ: the widths follow each input's own.
    limit = np.maximum(high - 20 * np.arange(inputs), 3)
    low, high = (-limit if input_signed else 0 * limit), limit
    layer = Layer(weight, bias, limit)
    dut = MvmTile(layer, input_width=width, input_signed=input_signed, group=group)
    assert dut.latency == latency

    x = vectors(layer, low, high, rng)
    a = layer.accumulate(x)
    assert np.abs(a).max() == layer.accumulator_bound
    check(
        dut,
        "mvm_tile",
        tmp_path,
        inputs=pack(x, width),
        expected=pack(a, layer.accumulator_width),
        latencies=[(k, k, latency) for k in range(len(x))],
    )


def test_most_negative_words(tmp_path):
    """−2**8 · −2**7 = 2**15 in every product: the bound reached from both most negative words."""
    layer = Layer(np.full((2, 5), -128), np.array([7, -7]), np.full(5, 256))
    x = np.array([[-256] * 5, [255] * 5, [0] * 5])
    a = layer.accumulate(x)
    assert np.abs(a).max() == layer.accumulator_bound
    check(
        MvmTile(layer, input_width=9, input_signed=True, group=1),
        "mvm_tile",
        tmp_path,
        inputs=pack(x, 9),
        expected=pack(a, layer.accumulator_width),
        stalls=[0],
    )


def test_latency_grows_with_the_logarithm_of_the_groups():
    def latency(inputs, group):
        layer = Layer(np.ones((1, inputs), dtype=int), np.zeros(1, dtype=int), np.ones(inputs, dtype=int))
        return MvmTile(layer, input_width=4, input_signed=True, group=group).latency

    assert [latency(n, 4) for n in (1, 4, 5, 8, 9, 16, 17)] == [3, 3, 4, 4, 5, 5, 6]
    assert [latency(16, g) for g in (1, 2, 4, 8, 16)] == [7, 6, 5, 4, 3]


@pytest.mark.parametrize(
    ("limit", "options", "message"),
    [
        (255, {"input_width": 9, "input_signed": True, "group": 0}, "group 0: expected at least 1"),
        (257, {"input_width": 9, "input_signed": True}, "input_limit 257: expected at most 256"),
        (127, {"input_width": 6, "input_signed": False}, "input_limit 127: expected at most 63"),
    ],
)
def test_refusals(limit, options, message):
    layer = Layer(np.ones((2, 3), dtype=int), np.zeros(2, dtype=int), np.full(3, limit))
    with pytest.raises(ValueError, match=message):
        MvmTile(layer, **options)
