# amaranth: UnusedElaboratable=no
"""Requantisation: a layer's accumulators, scaled and clipped, become the next layer's activations."""

from collections.abc import Sequence

import numpy as np
from amaranth import Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.adder_graph import AdderGraph, Range
from fastac.gateware.arithmetic.adder_pipeline import adder_pipeline, range_register
from fastac.gateware.arithmetic.adder_solver import adder_graph
from fastac.gateware.arithmetic.product import product
from fastac.gateware.arithmetic.shift_add import Register, Term, pipeline_register
from fastac.gateware.stream.handshake import credit_handshake
from fastac.models.integer.network import Requantisation

MULTIPLIER_BITS, SHIFT_BITS = 17, 6
COARSE = 3
"""Low bits of the shift amount that the second shift stage applies; the first applies the others."""
SCALE_STAGES = 4
"""Pipeline stages of scaling: product and shift, or the levels of additions of a baked multiplier."""


def unsigned_value(term: Term) -> Value:
    """The value of a non-negative term, without its sign bit."""
    return (term.value << term.shift)[:-1]


def scale_graph(scale: Requantisation, k: int, largest: int) -> tuple[Range, AdderGraph]:
    """What baked hardware multiplies of neuron `k`'s accumulators, at most `largest`, and how."""
    multiplier = int(scale.multiplier[k])
    least_clipped = -(-(1 << (scale.bits + scale.shift)) // multiplier)
    # Every accumulator with a bit above these is clipped.
    width = max(1, min(largest, least_clipped - 1).bit_length())
    held = Range(0, min(max(largest, 0), (1 << width) - 1))
    return held, adder_graph(np.array([[multiplier]]), [held], SCALE_STAGES)


class RequantiseCore(wiring.Component):
    """ReLU, scale and clip: min((max(a, 0) · multiplier) >> shift, 2**bits − 1), without a handshake.

    Members
    -------
    i : `len(scale.multiplier)` accumulators, one per neuron, signed(width)
    o : as many activations, unsigned(scale.bits)
    parameters : multipliers and shift, unsigned(17 · neurons + 6), as `parameter_image` packs them; constant
        while data is in flight. Only if `loadable`.

    largest : of each accumulator, if its word could hold more; baked hardware need not multiply more

    Loadable: one DSP slice per neuron, with its registers A, B, M and P: accumulators of 64 inputs of 10 bits
    and weights of 8 have the 25 bits that fit a DSP48E1 too; then the shift, first by a multiple of 8, then
    by 0 … 7.
    Baked: the product is a graph of additions (`adder_solver`), and the shift is wiring. Accumulators whose
    upper bits alone clip them are found beside it, so that only the lower bits are multiplied.
    `latency` = 6 clocks in either mode: operand, 4 of product and shift, clip.
    """

    latency = 2 + SCALE_STAGES

    def __init__(
        self,
        scale: Requantisation,
        *,
        width: int,
        loadable: bool = False,
        largest: Sequence[int] | None = None,
    ):
        self.scale, self.width, self.loadable = scale, width, loadable
        neurons = len(scale.multiplier)
        self.largest = tuple(largest or [(1 << (width - 1)) - 1] * neurons)
        members = {
            "i": In(data.ArrayLayout(signed(width), neurons)),
            "o": Out(data.ArrayLayout(unsigned(scale.bits), neurons)),
        }
        if loadable:
            members["parameters"] = In(unsigned(self.parameter_bits))
        super().__init__(members)

    @property
    def multipliers(self) -> int:
        """DSP slices; 0 if the multipliers are baked in."""
        return len(self.scale.multiplier) if self.loadable else 0

    @property
    def parameter_bits(self) -> int:
        """Bits of `parameters`; 0 if the multipliers are baked in."""
        return MULTIPLIER_BITS * len(self.scale.multiplier) + SHIFT_BITS if self.loadable else 0

    def parameter_image(self, scale: Requantisation) -> int:
        """The value of `parameters` for `scale`: the multipliers from bit 0, then the shift.

        Raises ValueError if `scale` has another number of neurons or bits than the hardware's.
        """
        if not self.loadable:
            raise ValueError("loadable False: expected True, baked multipliers are no parameters")
        if len(scale.multiplier) != len(self.scale.multiplier):
            raise ValueError(
                f"multiplier of {len(scale.multiplier)} neurons: expected {len(self.scale.multiplier)}"
            )
        if scale.bits != self.scale.bits:
            raise ValueError(f"bits {scale.bits}: expected {self.scale.bits}")
        words = [*map(int, scale.multiplier), scale.shift]
        return sum(word << (k * MULTIPLIER_BITS) for k, word in enumerate(words))

    def elaborate(self, platform):
        m = Module()
        register = pipeline_register(m)
        top = (1 << self.scale.bits) - 1
        for k, a in enumerate(self.i):
            if self.loadable:
                multiplier = self.parameters.word_select(k, MULTIPLIER_BITS)
                whole = product(m, platform, Const(1), a, multiplier, name=f"product_{k}")
                bound = ((1 << (self.width - 1)) - 1) * ((1 << MULTIPLIER_BITS) - 1)
                scaled, beyond = self._shifted(k, whole, bound, register), Const(0)
            else:
                scaled, beyond = self._baked(m, k, a)
            clip = beyond | scaled[self.scale.bits :].any()
            clipped = Term(Mux(clip, top, scaled[: self.scale.bits]), top)
            m.d.comb += self.o[k].eq(register(clipped, f"activation_{k}").value)
        return m

    def _shifted(self, k: int, whole: Signal, bound: int, register: Register) -> Value:
        """Loadable mode: neuron `k`'s product, 0 if negative, shifted right."""
        shift = self.parameters[-SHIFT_BITS:]
        coarse = Mux(whole < 0, 0, whole[:-1] >> (shift[COARSE:] << COARSE))
        coarse = register(Term(coarse, bound), f"coarse_{k}")
        return unsigned_value(register(Term(unsigned_value(coarse) >> shift[:COARSE], bound), f"shifted_{k}"))

    def _baked(self, m: Module, k: int, a: Value) -> tuple[Value, Value]:
        """Baked mode: neuron `k`'s accumulator, 0 if negative, multiplied and shifted right; whether its
        upper bits, which are not multiplied, clip it."""
        largest = self.largest[k]
        held, graph = scale_graph(self.scale, k, largest)
        width = held.width

        def register(value: Value, held: Range, name: str) -> Signal:
            return range_register(m, value, held, f"{name}_{k}")

        # The accumulator of a neuron that is never active needs no register.
        positive = register(Mux(a < 0, 0, a[: held.width] if held.high else 0), held, "positive")
        [product] = adder_pipeline(m, graph, [(positive, held)], SCALE_STAGES, f"product_{k}")
        beyond = Const(0)
        if largest >> width:
            beyond = ~a[-1] & a[width:-1].any()
            for stage in range(1 + SCALE_STAGES):
                beyond = register(beyond, Range(0, 1), f"beyond_at{stage}")
        return product.value.shift_left(product.shift).shift_right(self.scale.shift), beyond


class Requantise(wiring.Component):
    """`RequantiseCore` between two streams: one vector of accumulators per clock.

    Members
    -------
    i : stream of `len(scale.multiplier)` accumulators, signed(width)
    o : stream of as many activations, unsigned(scale.bits)
    parameters : see RequantiseCore. Only if `loadable`.

    `latency` = 6 clocks without back-pressure; initiation interval 1.
    """

    latency = RequantiseCore.latency

    def __init__(self, scale: Requantisation, *, width: int, loadable: bool = False):
        self.core = RequantiseCore(scale, width=width, loadable=loadable)
        neurons = len(scale.multiplier)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(signed(width), neurons))),
            "o": Out(stream.Signature(data.ArrayLayout(unsigned(scale.bits), neurons))),
        }
        if loadable:
            members["parameters"] = In(unsigned(self.core.parameter_bits))
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        m.submodules.core = core = self.core

        last, _ = credit_handshake(m, self.i, self.o, self.latency)
        m.d.comb += [core.i.eq(self.i.payload), last.payload.eq(core.o)]
        if core.loadable:
            m.d.comb += core.parameters.eq(self.parameters)
        return m
