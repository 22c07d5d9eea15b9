import numpy as np
import pytest
from amaranth import Const, Module, Signal, signed
from amaranth.sim import Simulator

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2
from fastac.gateware.arithmetic.packed_products import Packing, best_packing


@pytest.mark.parametrize(
    ("weight_limit", "input_limit", "input_width", "expected", "expected_of_25_bits"),
    [
        # Features: six products of 8 × 9 bits; 8-bit weights and activations of 10, 7 and 3 bits.
        (127, [255] * 4 + [127] * 2, 9, Packing(127, 19, 3), Packing(127, 17, 1)),
        (127, [1023] * 16, 11, Packing(127, 19, 1), None),
        (127, [1023], 11, Packing(127, 18, 0), None),
        (127, [511] * 16, 10, Packing(127, 19, 2), Packing(127, 17, 0)),
        (127, [127] * 16, 8, Packing(127, 19, 4), Packing(127, 17, 2)),
        (127, [7] * 16, 4, Packing(127, 15, 4), Packing(127, 15, 4)),
        # Weights of 7 bits leave room for activations of 10 in 25 bits.
        (63, [1023] * 16, 11, Packing(63, 20, 3), Packing(63, 18, 1)),
        # 12-bit weights: a product of 22 bits leaves no room for a second.
        (2047, [1023] * 16, 11, None, None),
        (2047, [7] * 16, 4, Packing(2047, 15, 0), None),
        (1, [1 << 17], 18, Packing(1, 19, 0), Packing(1, 19, 0)),
        (1, [1 << 17], 19, None, None),
    ],
)
@pytest.mark.parametrize("dsp", [DSP48E2, DSP48E1], ids=lambda dsp: dsp.name)
def test_best_packing(weight_limit, input_limit, input_width, expected, expected_of_25_bits, dsp):
    found = best_packing(weight_limit, input_limit, input_width, dsp)
    assert found == (expected if dsp is DSP48E2 else expected_of_25_bits)
    if found:
        largest = (1 << (dsp.wide_port - 1)) - 1
        # One more level would not fit, or there are no more products to sum.
        group = 1 << found.levels
        reached = max(sum(input_limit[k : k + group]) for k in range(0, len(input_limit), group))
        assert weight_limit * reached <= (1 << (found.shift - 1)) - 1
        assert found.limit <= largest
        more = max(sum(input_limit[k : k + 2 * group]) for k in range(0, len(input_limit), 2 * group))
        wider = (weight_limit * more).bit_length() + 1
        assert more == reached or (weight_limit << wider) + weight_limit > largest


@pytest.mark.parametrize(
    ("dsp", "weight_limit", "input_limit", "summed"),
    [
        (DSP48E2, 127, 1023, 2),
        (DSP48E1, 127, 511, 1),
        (DSP48E1, 63, 1023, 2),
        (DSP48E1, 127, 127, 4),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_split_at_the_extremes_of_the_lower_field(dsp, weight_limit, input_limit, summed):
    chosen = best_packing(weight_limit, [input_limit] * 16, input_limit.bit_length() + 1, dsp)
    assert 1 << chosen.levels == summed
    limit = (1 << (chosen.shift - 1)) - 1
    reached = weight_limit * summed * input_limit
    assert reached <= limit
    lowers = [0, 1, -1, reached, -reached, limit, -limit]
    cases = [(low, high) for low in lowers for high in (0, 1, -1, reached, -reached)]
    biases = [(0, 0), (5000, -7000), (-1, 1), (-(1 << 20), (1 << 20) - 1)]
    m = Module()
    total, biased = Signal(signed(48)), [Signal(signed(24), name=f"bias_{k}") for k in range(2)]
    outputs = [Signal(signed(32), name=f"output_{k}") for k in range(2)]
    m.d.comb += [o.eq(v) for o, v in zip(outputs, chosen.split(total, *biased), strict=True)]
    seen = []

    async def bench(ctx):
        for low, high in cases:
            for bias in biases:
                ctx.set(total, chosen.word(low, high))
                for signal, value in zip(biased, bias, strict=True):
                    ctx.set(signal, value)
                await ctx.delay(1e-9)
                seen.append(tuple(ctx.get(o) for o in outputs) == (low + bias[0], high + bias[1]))

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()
    assert len(seen) == len(cases) * len(biases)
    assert np.all(seen)


def test_split_without_biases():
    chosen = Packing(127, 19, 1)
    lower, upper = chosen.split(Const(chosen.word(-5, 3), signed(30)), *2 * [Const(0, signed(1))])
    m, sums = Module(), [Signal(signed(24), name=f"sum_{k}") for k in range(2)]
    m.d.comb += [sums[0].eq(lower), sums[1].eq(upper)]
    seen = []

    async def bench(ctx):
        await ctx.delay(1e-9)
        seen.extend(ctx.get(s) for s in sums)

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()
    assert seen == [-5, 3]
