# amaranth: UnusedElaboratable=no
"""From a layer's accumulators to the next layer's activations, with multipliers loadable or baked in."""

from amaranth import Cat, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.product import product
from fastac.gateware.arithmetic.shift_add import Register, Term, constant_product, pipeline_register
from fastac.models.integer.network import Requantisation

MULTIPLIER_BITS, SHIFT_BITS = 17, 6
COARSE = 3
"""Low bits of the shift that its second stage is left with."""
SCALE_STAGES = 4
"""Registers of product and shift: two each, or levels of additions."""


def unsigned_value(term: Term) -> Value:
    """A term that is never negative, without its sign."""
    return (term.value << term.shift)[:-1]


class RequantiseCore(wiring.Component):
    """Requantise one accumulator of every neuron a clock, without a handshake.

    Members
    -------
    advance : the registers move in clocks in which it is high
    i : `len(scale.multiplier)` accumulators, signed(width)
    o : as many activations, unsigned(scale.bits)
    parameters : multipliers and shift, as `parameter_image` gives them; constant while accumulators are under
        way. Only if `loadable`.

    Loadable: a multiplier for every neuron, one DSP48E2 where width <= 27, with the registers before (A, B)
    and behind it (M, P); then the positive part's shift by multiples of 8, and by 0 … 7. Baked: the product
    is a sum of the multiplier's signed digits, and the shift a choice of bits.
    The activations stand in `o` after `latency` = 6 advances in either mode: the operand, four registers of
    product and shift, the clip.
    """

    latency = 2 + SCALE_STAGES

    def __init__(self, scale: Requantisation, *, width: int, loadable: bool = False):
        self.scale, self.width, self.loadable = scale, width, loadable
        neurons = len(scale.multiplier)
        members = {
            "advance": In(1),
            "i": In(data.ArrayLayout(signed(width), neurons)),
            "o": Out(data.ArrayLayout(unsigned(scale.bits), neurons)),
        }
        if loadable:
            members["parameters"] = In(unsigned(self.parameter_bits))
        super().__init__(members)

    @property
    def multipliers(self) -> int:
        """Multipliers; 0 if they are baked in."""
        return len(self.scale.multiplier) if self.loadable else 0

    @property
    def parameter_bits(self) -> int:
        """Bits of `parameters`; 0 if the multipliers are baked in."""
        return MULTIPLIER_BITS * len(self.scale.multiplier) + SHIFT_BITS if self.loadable else 0

    def parameter_image(self, scale: Requantisation) -> int:
        """What `parameters` is for `scale`, of as many neurons and bits: the multipliers, then the shift.

        Raises ValueError for others.
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
        register = pipeline_register(m, self.advance)
        largest = (1 << (self.width - 1)) - 1
        top = (1 << self.scale.bits) - 1
        for k, a in enumerate(self.i):
            if self.loadable:
                multiplier = self.parameters.word_select(k, MULTIPLIER_BITS)
                whole = product(m, platform, self.advance, a, multiplier, name=f"product_{k}")
                scaled = self._shifted(k, whole, largest * ((1 << MULTIPLIER_BITS) - 1), register)
            else:
                positive = register(Term(Mux(a < 0, 0, a), largest), f"positive_{k}")
                scaled = self._baked(k, positive, register)
            clipped = Term(Mux(scaled[self.scale.bits :].any(), top, scaled[: self.scale.bits]), top)
            m.d.comb += self.o[k].eq(register(clipped, f"activation_{k}").value)
        return m

    def _shifted(self, k: int, whole: Signal, bound: int, register: Register) -> Value:
        """Neuron `k`'s product, its positive part shifted."""
        shift = self.parameters[-SHIFT_BITS:]
        coarse = Mux(whole < 0, 0, whole[:-1] >> (shift[COARSE:] << COARSE))
        coarse = register(Term(coarse, bound), f"coarse_{k}")
        return unsigned_value(register(Term(unsigned_value(coarse) >> shift[:COARSE], bound), f"shifted_{k}"))

    def _baked(self, k: int, positive: Term, register: Register) -> Value:
        """Neuron `k`'s positive part, multiplied and shifted."""
        taps = [positive]
        for stage in range(1, SCALE_STAGES + 1):
            taps.append(register(taps[-1], f"positive_{k}_at{stage}"))
        multiplier = int(self.scale.multiplier[k])
        product = constant_product(
            multiplier, [tap.value for tap in taps], positive.bound, register, f"product_{k}"
        )
        return unsigned_value(product).shift_right(self.scale.shift)


class Requantise(wiring.Component):
    """Requantise one accumulator of every neuron a clock: `RequantiseCore` between two streams.

    Members
    -------
    i : stream of `len(scale.multiplier)` accumulators, signed(width)
    o : stream of as many activations, unsigned(scale.bits)
    parameters : see RequantiseCore. Only if `loadable`.

    `latency` clocks pass from an accepted vector to its activations if nothing stalls.
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

        # The core never stalls by itself; it moves whenever its last register may move.
        valid = Signal(self.latency)
        m.d.comb += [
            core.advance.eq(self.o.ready | ~self.o.valid),
            core.i.eq(self.i.payload),
            self.i.ready.eq(core.advance),
            self.o.payload.eq(core.o),
            self.o.valid.eq(valid[-1]),
        ]
        if core.loadable:
            m.d.comb += core.parameters.eq(self.parameters)
        with m.If(core.advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))
        return m
