# amaranth: UnusedElaboratable=no
"""Two products in one multiplier are two products: for all operands of 8 bits, and for all sums of wide ones.

All 2^24 operands are tried with one product. A sum of packed products is one word again: by the distributive
law (upper·2^shift + lower)·x, added up, is (Σ upper·x)·2^shift + Σ lower·x. So what remains to be shown of
sums of any operands is that `split` takes such a word apart, whatever both sums are; z3 shows that at the
shipped widths.
"""

from functools import partial

import numpy as np
from amaranth import Cat, Const, Module, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2, DspSlice
from fastac.gateware.arithmetic.packed_products import Packing, best_packing
from fastac.gateware.mlp_mvm import MvmCore
from fastac.models.integer.network import Layer
from fastac.models.integer.words import signed_width
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.exhaustive import Exhaustive, Trial
from fastac.sim.formal.proof import Proof

SIDE_BITS, CASE_BITS = 4, 20
SIDE_BY_SIDE = 1 << SIDE_BITS
"""Cases in one clock."""
LIMIT = 1 << 7
"""Largest magnitude of a signed word of 8 bits."""


class ProductTrial(Trial):
    """All pairs of weights and all inputs of 8 bits, signed, in one packed product each."""

    def __init__(self, packing: type):
        self.packing = packing(LIMIT, signed_width(LIMIT * LIMIT), 0)
        super().__init__()

    def elaborate(self, platform):
        m = Module()
        case = Signal(CASE_BITS)
        m.d.sync += [case.eq(case + 1), self.done.eq(self.done | case.all())]
        wrong = []
        for k in range(SIDE_BY_SIDE):
            lower, upper, x = _operands(case, k)
            total = Signal(signed(self.packing.width + 8), name=f"total_{k}")
            m.d.comb += total.eq(self.packing.word(lower, upper) * x)
            found = self.packing.split(total, *2 * [Const(0, signed(1))])
            wrong.append((found[0] != lower * x) | (found[1] != upper * x))
        self.count(m, [~self.done] * SIDE_BY_SIDE, wrong)
        return m


class TileTrial(Trial):
    """All loadable weights of 8 bits and all inputs in tiles of two neurons that share a multiplier."""

    def __init__(self, core: type):
        weight, bias = np.zeros((2, 1), int), np.zeros(2, int)
        self.layer = Layer(weight, bias, np.array([LIMIT]), loadable=True)
        self.cores = [core(self.layer, input_width=8, input_signed=True) for _ in range(SIDE_BY_SIDE)]
        super().__init__()

    def elaborate(self, platform):
        m = Module()
        latency = self.cores[0].latency
        clock, case, before = Signal(CASE_BITS + 1), Signal(CASE_BITS), Signal(CASE_BITS)
        last = (1 << CASE_BITS) + latency - 1
        m.d.comb += [case.eq(clock - latency), before.eq(clock - 1)]
        m.d.sync += [clock.eq(clock + 1), self.done.eq(self.done | (clock == last))]
        tried, wrong = [], []
        top = self.layer.bias_limit
        for k, core in enumerate(self.cores):
            m.submodules[f"core_{k}"] = core
            biases = [(0, 0), (top, -top), (-top, top), (-1, 1)][k % 4]
            lower, upper, _ = _operands(before, k)  # a weight is read one clock after its input
            word = core.packing.word(lower, upper)[: core.packing.width]
            constants = [Const(bias, core.bias_width) for bias in biases]
            m.d.comb += [
                core.i[0].eq(_operands(clock, k)[2]),
                core.parameters.eq(Cat(word, constants)),
            ]
            lower, upper, x = _operands(case, k)
            tried.append((clock >= latency) & ~self.done & (lower != -LIMIT) & (upper != -LIMIT))
            expected = [weight * x + bias for weight, bias in zip((lower, upper), biases, strict=True)]
            wrong.append((core.o[0] != expected[0]) | (core.o[1] != expected[1]))
        self.count(m, tried, wrong)
        return m


def _operands(case: Value, k: int) -> tuple[Value, Value, Value]:
    """Lower and upper weight and input of instance `k` in `case`, 8 bits each, signed."""
    x = Cat(Const(k, SIDE_BITS), case[: 8 - SIDE_BITS])
    return (
        case[8 - SIDE_BITS : 16 - SIDE_BITS].as_signed(),
        case[16 - SIDE_BITS :][:8].as_signed(),
        x.as_signed(),
    )


class SplitSums(wiring.Component):
    """A packed word with given lower and upper sums, split again, as a tile does it."""

    def __init__(self, packing, inputs: int):
        self.packing, self.inputs = packing, inputs
        self.reached = packing.weight_limit * inputs
        word, wider = signed(signed_width(self.reached)), signed(signed_width(2 * self.reached))
        super().__init__(
            {
                "lower": In(word),
                "upper": In(word),
                "lower_bias": In(word),
                "upper_bias": In(word),
                "lower_sum": Out(wider),
                "upper_sum": Out(wider),
            }
        )

    def elaborate(self, platform):
        m = Module()
        total = Signal(signed(signed_width(self.packing.limit * self.inputs)))
        m.d.comb += total.eq(self.packing.word(self.lower, self.upper))
        lower, upper = self.packing.split(total, self.lower_bias, self.upper_bias)
        m.d.comb += [self.lower_sum.eq(lower), self.upper_sum.eq(upper)]
        return m


def split(
    packing: type, weight_limit: int, input_limit: list[int], input_width: int, dsp: DspSlice
) -> FormalBench:
    """The two sums come out of a packed sum, with their biases, whatever they are."""
    best = best_packing(weight_limit, input_limit, input_width, dsp)
    group = 1 << best.levels
    inputs = max(sum(input_limit[k : k + group]) for k in range(0, len(input_limit), group))
    dut = SplitSums(packing(best.weight_limit, best.shift, best.levels), inputs)
    bench = FormalBench(dut)
    for name in ("lower", "upper"):
        own = getattr(dut, name)
        value = Signal.like(own, name=f"free_{name}")
        bench.m.d.comb += value.eq(bench.free(name, len(own)))
        bench.drive(own, value)
        bench.assume((value <= dut.reached) & (value >= -dut.reached))
        bench.always(f"the {name} sum", getattr(dut, f"{name}_sum") == value + getattr(dut, f"{name}_bias"))
    return bench


UNCORRECTED = ("Cat(total[self.shift - 1], upper_bias)", "Cat(Const(0, 1), upper_bias)")
"""The correction of the borrow left out."""

PROOFS = (
    Exhaustive(
        "packed_products",
        Packing,
        "both weights and the input of 8 bits, signed: 2^24 cases",
        "each packed product is two products",
        ProductTrial,
        cases=1 << 24,
        clocks=(1 << CASE_BITS) + 16,
        breaks=(UNCORRECTED,),
    ),
    Exhaustive(
        "packed_tile",
        MvmCore,
        "two neurons, one input of 8 bits, all weights that can be loaded (-127 to 127), largest biases too",
        "each neuron's sum is a product and a bias",
        TileTrial,
        cases=255 * 255 * 256,
        clocks=(1 << CASE_BITS) + 32,
        breaks=(
            ("added = biases if j == 0 else [nothing, nothing]", "added = [nothing, nothing]"),
            (
                "largest = self.packing.limit if packed else",
                "largest = self.packing.limit // 2 if packed else",
            ),
        ),
    ),
    *(
        Proof(
            f"packed_sums_{len(input_limit)}_{input_width}" + suffix,
            Packing,
            f"sums of {len(input_limit)} products, weights to {weight_limit}, inputs of {input_width} bits,"
            f" {dsp.name}",
            partial(
                split, weight_limit=weight_limit, input_limit=input_limit, input_width=input_width, dsp=dsp
            ),
            depth=1,
            breaks=(UNCORRECTED, ("total[: self.shift].as_signed()", "total[: self.shift]")),
            broken_depth=2,
            quick=True,
        )
        for weight_limit, input_limit, input_width, dsp, suffix in (
            (127, [255] * 4 + [127] * 2, 9, DSP48E2, ""),
            (127, [127] * 16, 8, DSP48E2, ""),
            (127, [127] * 16, 8, DSP48E1, "_dsp48e1"),
        )
    ),
)
