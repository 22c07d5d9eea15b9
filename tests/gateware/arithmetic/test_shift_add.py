# amaranth: UnusedElaboratable=no
from itertools import pairwise

import pytest
from amaranth import Module, Signal, signed
from amaranth.sim import Simulator

from fastac.gateware.arithmetic.shift_add import (
    Term,
    canonical_signed_digits,
    constant_product,
    partial_adder_tree,
    pipeline_register,
)

CONSTANTS = [*range(-128, 0), *range(1, 128), 2047, -2048, 1365, -1365, 77_771, 131_071, 87_381]


def test_canonical_signed_digits():
    assert canonical_signed_digits(0) == []
    assert canonical_signed_digits(7) == [(0, -1), (3, 1)]
    assert canonical_signed_digits(-5) == [(0, -1), (2, -1)]
    for constant in CONSTANTS:
        digits = canonical_signed_digits(constant)
        assert sum(sign << exponent for exponent, sign in digits) == constant
        exponents = [exponent for exponent, _ in digits]
        assert all(high - low > 1 for low, high in pairwise(exponents))
    assert max(len(canonical_signed_digits(c)) for c in range(-128, 128)) == 4
    assert max(len(canonical_signed_digits(c)) for c in range(-2048, 2048)) == 6
    assert max(len(canonical_signed_digits(c)) for c in range(1 << 17)) == 9


@pytest.mark.parametrize("limit", [1, 256])
@pytest.mark.quick("256")
def test_constant_products_and_their_sum(limit):
    """Every product after four clocks, with its deferred sign and shift, and the sum of all products."""
    m, enable = Module(), Signal(init=1)
    register = pipeline_register(m, enable)
    taps = [Signal(signed(limit.bit_length() + 1), name="x")]
    for stage in range(1, 5):
        taps.append(register(Term(taps[-1], limit), f"x_at{stage}").value)
    products = [constant_product(c, taps, limit, register, f"p{k}") for k, c in enumerate(CONSTANTS)]
    levels = (len(products) - 1).bit_length()
    [total] = partial_adder_tree(products, levels, register, "sum")
    assert total.bound == sum(map(abs, CONSTANTS)) * limit
    wrong = []

    async def bench(ctx):
        for x in (limit, -limit, 0, 1, -1):
            ctx.set(taps[0], x)
            await ctx.tick().repeat(4)
            for constant, product in zip(CONSTANTS, products, strict=True):
                value = (ctx.get(product.value) << product.shift) * (-1 if product.negative else 1)
                if value != constant * x or abs(value) > product.bound:
                    wrong.append((constant, x, value))
            await ctx.tick().repeat(levels)
            value = (ctx.get(total.value) << total.shift) * (-1 if total.negative else 1)
            if value != sum(CONSTANTS) * x:
                wrong.append(("sum", x, value))

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert wrong == []


def test_registers_hold_without_enable():
    m, enable, x = Module(), Signal(), Signal(signed(4))
    held = pipeline_register(m, enable)(Term(x, 7), "held").value
    seen = []

    async def bench(ctx):
        for e, value in ((1, 5), (0, -3), (0, 2), (1, -7)):
            ctx.set(enable, e)
            ctx.set(x, value)
            await ctx.tick()
            seen.append(ctx.get(held))

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert seen == [5, 5, 5, -7]


def test_constant_with_too_many_digits_for_the_taps():
    m, taps = Module(), [Signal(4, name=f"x{k}") for k in range(3)]
    with pytest.raises(ValueError, match="constant 1365 of 6 digits: expected at most 4"):
        constant_product(1365, taps, 7, pipeline_register(m, Signal()), "p")
