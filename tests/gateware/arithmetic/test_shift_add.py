# amaranth: UnusedElaboratable=no
from itertools import pairwise

from amaranth import Module, Signal, signed
from amaranth.sim import Simulator

from fastac.gateware.arithmetic.shift_add import (
    Term,
    canonical_signed_digits,
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


def test_sums_of_terms_with_shifts_and_signs():
    m, limit = Module(), 256
    register = pipeline_register(m)
    x = Signal(signed(10))
    factors = [5, -3, 8, -64, 1, -7, 2]
    terms = []
    for factor in factors:
        shift = (factor & -factor).bit_length() - 1
        value = register(Term(x * (abs(factor) >> shift), limit * (abs(factor) >> shift)), f"x{factor}").value
        terms.append(Term(value, limit * abs(factor), shift, factor < 0))
    levels = (len(terms) - 1).bit_length()
    [total] = partial_adder_tree(terms, levels, register, "sum")
    assert total.bound == sum(map(abs, factors)) * limit
    wrong = []

    async def bench(ctx):
        for given in (limit, -limit, 0, 1, -1):
            ctx.set(x, given)
            await ctx.tick().repeat(1 + levels)
            value = (ctx.get(total.value) << total.shift) * (-1 if total.negative else 1)
            if value != sum(factors) * given:
                wrong.append((given, value))

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    assert wrong == []
