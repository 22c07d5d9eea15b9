# amaranth: UnusedElaboratable=no
"""Matrix-vector product of a fully connected layer, fully unrolled, with loadable or baked-in weights."""

from functools import cached_property

import numpy as np
from amaranth import Const, Module, Shape, Value, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.adder_graph import AdderGraph, Range
from fastac.gateware.arithmetic.adder_pipeline import adder_pipeline, range_register
from fastac.gateware.arithmetic.adder_solver import adder_graph
from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.packed_products import Packing, best_packing
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_STAGES
from fastac.gateware.arithmetic.product import product
from fastac.gateware.arithmetic.shift_add import (
    Register,
    Term,
    partial_adder_tree,
    pipeline_register,
)
from fastac.gateware.stream.handshake import credit_handshake
from fastac.models.integer.network import Layer
from fastac.models.integer.words import signed_width


def tile_latency(inputs: int) -> int:
    """Latency of a tile in clocks, loadable or baked: input register, product, adder tree, bias."""
    return 1 + PRODUCT_STAGES + (inputs - 1).bit_length() + 1


def tile_multipliers(neurons: int, inputs: int, *, packed: bool) -> int:
    """DSP slices of a loadable tile: one per input and neuron, or per pair of neurons if `packed`."""
    return -(-neurons // (2 if packed else 1)) * inputs


def tile_layouts(
    layer: Layer, *, input_width: int, input_signed: bool
) -> tuple[data.ArrayLayout, data.ArrayLayout]:
    """Layouts of the inputs and accumulators of `layer`; ValueError if a limit exceeds the inputs' width."""
    neurons, inputs = layer.weight.shape
    largest = 1 << (input_width - 1) if input_signed else (1 << input_width) - 1
    if layer.input_limit.max() > largest:
        raise ValueError(f"input_limit {layer.input_limit.max()}: expected at most {largest}")
    return (
        data.ArrayLayout(Shape(input_width, input_signed), inputs),
        data.ArrayLayout(signed(layer.accumulator_width), neurons),
    )


def input_ranges(layer: Layer, *, input_signed: bool) -> list[Range]:
    """What a layer says of its inputs."""
    return [Range(-x if input_signed else 0, x) for x in layer.input_limit.tolist()]


def accumulator_ranges(layer: Layer, *, input_signed: bool) -> list[Range]:
    """What each accumulator takes with the layer's own weights and biases; both ends are reached."""
    low, high = (
        np.array([getattr(x, end) for x in input_ranges(layer, input_signed=input_signed)])
        for end in ("low", "high")
    )
    up, down = np.maximum(layer.weight, 0), np.minimum(layer.weight, 0)
    least, most = up @ low + down @ high + layer.bias, up @ high + down @ low + layer.bias
    return [Range(*ends) for ends in zip(least.tolist(), most.tolist(), strict=True)]


def layer_graph(layer: Layer, *, input_signed: bool) -> AdderGraph:
    """The additions of baked weights, without those of the biases."""
    depth = PRODUCT_STAGES + (layer.weight.shape[1] - 1).bit_length()
    return adder_graph(layer.weight, input_ranges(layer, input_signed=input_signed), depth)


class MvmCore(wiring.Component):
    """Compute `layer.weight @ i + layer.bias` for one vector per clock, without a handshake.

    Members
    -------
    i : inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]
    o : accumulators with their biases, signed(layer.accumulator_width) each
    parameters : weights and biases, unsigned(parameter_bits), as `parameter_image` packs them; constant while
        data is in flight. Only if `layer.loadable`.

    Loadable: two neurons share a multiplier of `dsp` if `best_packing` finds that both products fit;
    otherwise, and for an odd neuron, there is one multiplier per weight. Operands (A, B), products (M, P) and
    every sum are registered. Packed products are summed as long as the sums fit their fields, then split into
    the two neurons' sums, which get the biases, and then summed on for each neuron.
    A product or sum has signed_width(Σ|w|·input_limit) bits, with layer.weight_limit for |w|.
    Baked: additions of shifted inputs and sums, without multipliers; neurons share the sums that they have in
    common (`adder_solver`), and each sum has the bits of its own exact range.

    There is one addition between two registers.
    `latency` = 5 + ceil(log2(inputs)) clocks in either mode.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, dsp: DspSlice = DSP48E2):
        self.layer, self.dsp = layer, dsp
        self.input_width, self.input_signed = input_width, input_signed
        self.latency = tile_latency(layer.weight.shape[1])
        i, o = tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        members = {"i": In(i), "o": Out(o)}
        if layer.loadable:
            members["parameters"] = In(unsigned(self.parameter_bits))
        super().__init__(members)

    @cached_property
    def packing(self) -> Packing | None:
        """How pairs of neurons share multipliers; None if two products do not fit."""
        width = self.input_width if self.input_signed else self.input_width + 1
        return best_packing(self.layer.weight_limit, self.layer.input_limit, width, self.dsp)

    @property
    def units(self) -> list[tuple[int, ...]]:
        """Groups of neurons that share multipliers: pairs, and single ones."""
        neurons = len(self.layer.weight)
        together = 2 if self.packing else 1
        return [tuple(range(k, min(k + together, neurons))) for k in range(0, neurons, together)]

    def word_width(self, unit: tuple[int, ...]) -> int:
        """Bits of the weight operand of the multipliers of `unit`."""
        return self.packing.width if len(unit) == 2 else self.layer.weight_bits

    @property
    def bias_width(self) -> int:
        return signed_width(self.layer.bias_limit)

    @property
    def multipliers(self) -> int:
        """DSP slices; 0 if the weights are baked in."""
        if not self.layer.loadable:
            return 0
        return tile_multipliers(*self.layer.weight.shape, packed=self.packing is not None)

    @property
    def parameter_bits(self) -> int:
        """Bits of `parameters`; 0 if the weights are baked in."""
        neurons, inputs = self.layer.weight.shape
        if not self.layer.loadable:
            return 0
        return inputs * sum(map(self.word_width, self.units)) + neurons * self.bias_width

    def parameter_image(self, layer: Layer) -> int:
        """The value of `parameters` for `layer`, of the same shape and limits as the hardware's.

        From bit 0: for each of `units` a word per input, then the biases. Raises ValueError if shape or
        limits differ.
        """
        own = self.layer
        if not own.loadable or not layer.loadable:
            raise ValueError("loadable False: expected True, baked weights are no parameters")
        if layer.weight.shape != own.weight.shape:
            raise ValueError(f"weight {layer.weight.shape}: expected {own.weight.shape}")
        if layer.weight_bits != own.weight_bits:
            raise ValueError(f"weight_bits {layer.weight_bits}: expected {own.weight_bits}")
        if not np.array_equal(layer.input_limit, own.input_limit):
            raise ValueError(f"input_limit {layer.input_limit}: expected {own.input_limit}")
        image, low = 0, 0

        def append(word: int, width: int) -> None:
            nonlocal image, low
            image |= (word & ((1 << width) - 1)) << low
            low += width

        for unit in self.units:
            for weights in layer.weight[list(unit)].T.tolist():
                append(self.packing.word(*weights) if len(unit) == 2 else weights[0], self.word_width(unit))
        for bias in layer.bias.tolist():
            append(bias, self.bias_width)
        return image

    def elaborate(self, platform):
        m = Module()
        register = pipeline_register(m)
        inputs = [
            register(Term(x, int(limit)), f"input_{j}")
            for j, (x, limit) in enumerate(zip(self.i, self.layer.input_limit, strict=True))
        ]
        if self.layer.loadable:
            accumulators = self._loadable(m, platform, inputs, register)
        else:
            accumulators = self._baked(m, inputs)
        for k, accumulator in enumerate(accumulators):
            m.d.comb += self.o[k].eq(accumulator.value)
        return m

    @property
    def _levels(self) -> int:
        return (self.layer.weight.shape[1] - 1).bit_length()

    def _loadable(self, m: Module, platform, inputs: list[Term], register: Register) -> list[Term]:
        """Every neuron's accumulator, with the weights and biases of `parameters`."""
        low = 0

        def parameter(width: int) -> Value:
            nonlocal low
            low += width
            return self.parameters[low - width : low].as_signed()

        words = [[parameter(self.word_width(unit)) for _ in inputs] for unit in self.units]
        limit = self.layer.bias_limit
        biases = [Term(parameter(self.bias_width), limit) for _ in self.layer.weight]
        accumulators = []
        for unit, weights in zip(self.units, words, strict=True):
            packed, name = len(unit) == 2, f"{unit[0]}"
            largest = self.packing.limit if packed else self.layer.weight_limit
            terms = []
            for j, (x, weight) in enumerate(zip(inputs, weights, strict=True)):
                whole = product(m, platform, Const(1), x.value, weight, name=f"product_{name}_{j}")
                bound = largest * x.bound
                terms.append(Term(whole[: signed_width(bound)].as_signed(), bound))
            if packed:
                accumulators += self._split_sum(terms, [biases[k] for k in unit], register, name)
            else:
                accumulators.append(self._biased_sum(terms, biases[unit[0]], register, name))
        return accumulators

    def _baked(self, m: Module, inputs: list[Term]) -> list[Term]:
        """Every neuron's accumulator, with constant weights and biases."""
        ranges = input_ranges(self.layer, input_signed=self.input_signed)
        values = [
            (x.value if held.signed else x.value[: held.width], held)
            for x, held in zip(inputs, ranges, strict=True)
        ]
        graph = layer_graph(self.layer, input_signed=self.input_signed)
        sums = adder_pipeline(m, graph, values, PRODUCT_STAGES + self._levels, "sum")
        reached = accumulator_ranges(self.layer, input_signed=self.input_signed)
        accumulators = []
        for k, (total, held) in enumerate(zip(sums, reached, strict=True)):
            constant = int(self.layer.bias[k])
            bias = Term(Const(constant), abs(constant))
            if total is not None:
                biased = total.plus(bias, total.bound + bias.bound)
                bias = Term(range_register(m, biased.value, held, f"biased_{k}"), biased.bound)
            accumulators.append(bias)
        return accumulators

    def _biased_sum(self, terms: list[Term], bias: Term, register: Register, name: str) -> Term:
        """The sum of a neuron's products and its bias."""
        [total] = partial_adder_tree(terms, self._levels, register, f"sum_{name}")
        return register(total.plus(bias, total.bound + bias.bound), f"biased_{name}")

    def _split_sum(self, terms: list[Term], biases: list[Term], register: Register, name: str) -> list[Term]:
        """Two neurons' sums: add packed products while the fields can hold the sum, split, add the rest."""
        nothing = Term(Const(0, signed(1)), 0)
        halves = [[], []]
        totals = partial_adder_tree(terms, self.packing.levels, register, f"packed_{name}")
        for j, total in enumerate(totals):
            added = biases if j == 0 else [nothing, nothing]
            reached = total.bound // self.packing.limit * self.packing.weight_limit
            values = self.packing.split(total.value, *(bias.value for bias in added))
            for half, value, bias, field in zip(halves, values, added, ("lower", "upper"), strict=True):
                half.append(register(Term(value, reached + bias.bound), f"{field}_{name}_{j}"))
        levels = self._levels - self.packing.levels
        return [
            partial_adder_tree(half, levels, register, f"sum_{field}_{name}")[0]
            for half, field in zip(halves, ("lower", "upper"), strict=True)
        ]


class MvmTile(wiring.Component):
    """`MvmCore` between two streams: `layer.weight @ i + layer.bias` for one vector per clock.

    Members
    -------
    i : stream of inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]
    o : stream of accumulators with their biases, signed(layer.accumulator_width) each
    parameters : see MvmCore. Only if `layer.loadable`.

    `latency` = 5 + ceil(log2(inputs)) clocks without back-pressure; initiation interval 1.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, dsp: DspSlice = DSP48E2):
        self.core = MvmCore(layer, input_width=input_width, input_signed=input_signed, dsp=dsp)
        self.latency = self.core.latency
        i, o = tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        members = {"i": In(stream.Signature(i)), "o": Out(stream.Signature(o))}
        if layer.loadable:
            members["parameters"] = In(unsigned(self.core.parameter_bits))
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        m.submodules.core = core = self.core

        last, _ = credit_handshake(m, self.i, self.o, self.latency)
        m.d.comb += [core.i.eq(self.i.payload), last.payload.eq(core.o)]
        if core.layer.loadable:
            m.d.comb += core.parameters.eq(self.parameters)
        return m
