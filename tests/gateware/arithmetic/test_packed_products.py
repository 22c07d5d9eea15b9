import numpy as np
import pytest
from amaranth import Const, Module, Signal, signed
from amaranth.sim import Simulator

from fastac.gateware.arithmetic.packed_products import Packing, best_packing


@pytest.mark.parametrize(
    ("weight_limit", "input_limit", "input_width", "expected"),
    [
        # Features: six products of 8 × 9 bits; 8-bit weights and activations of 10, 7 and 3 bits.
        (127, [255] * 4 + [127] * 2, 9, Packing(127, 19, 3)),
        (127, [1023] * 16, 11, Packing(127, 19, 1)),
        (127, [1023], 11, Packing(127, 18, 0)),
        (127, [127] * 16, 8, Packing(127, 19, 4)),
        (127, [7] * 16, 4, Packing(127, 15, 4)),
        # 12-bit weights: a product of 22 bits leaves no room for a second.
        (2047, [1023] * 16, 11, None),
        (2047, [7] * 16, 4, Packing(2047, 15, 0)),
        (1, [1 << 17], 18, Packing(1, 19, 0)),
        (1, [1 << 17], 19, None),
    ],
)
def test_best_packing(weight_limit, input_limit, input_width, expected):
    found = best_packing(weight_limit, input_limit, input_width)
    assert found == expected
    if found:
        # One more level would not fit, or there are no more products to sum.
        group = 1 << found.levels
        reached = max(sum(input_limit[k : k + group]) for k in range(0, len(input_limit), group))
        assert weight_limit * reached <= (1 << (found.shift - 1)) - 1
        assert found.limit <= (1 << 26) - 1
        more = max(sum(input_limit[k : k + 2 * group]) for k in range(0, len(input_limit), 2 * group))
        wider = (weight_limit * more).bit_length() + 1
        assert more == reached or (weight_limit << wider) + weight_limit > (1 << 26) - 1


def test_split_at_the_extremes_of_the_lower_field():
    chosen = best_packing(127, [1023] * 16, 11)
    limit = (1 << (chosen.shift - 1)) - 1
    reached = 127 * 2 * 1023
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
