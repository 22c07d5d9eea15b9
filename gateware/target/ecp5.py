"""Lattice ECP5 as an elaboration platform: products in its registered 18×18-bit multipliers."""

from collections.abc import Iterable, Sequence

from amaranth import ClockSignal, Instance, Module, Signal, signed

from fastac.gateware.arithmetic.product import sum_shape

OPERAND_BITS = 18
"""Bits of each operand of a MULT18X18D, signed."""


class Ecp5:
    """Platform whose methods replace those of `gateware.arithmetic.product` and `product_cascade` on an ECP5.

    An operand wider than 18 bits is cut into its 17 lowest bits, unsigned, and the rest. The two products
    are added after the multipliers' output registers. Latencies are those of DSP48E2: 3 clocks for a product.
    """

    def product(
        self, m: Module, advance: Signal, a, b, *, addend=None, bound: int | None = None, name: str
    ) -> Signal:
        """As `gateware.arithmetic.product.product`; ValueError beyond signed 35×18 bits."""
        total = self.sum_of_parts(m, advance, a, b, name=name)
        if addend is not None:
            total = total + addend
        return self.registered(m, advance, total, sum_shape(a * b, addend, bound), f"{name}_p")

    def product_cascade(
        self,
        m: Module,
        advance: Signal,
        operands: Iterable,
        bounds: Sequence[int],
        *,
        start: int = 0,
        wait: int = 0,
        name: str,
    ) -> Signal:
        """As `gateware.arithmetic.product_cascade.product_cascade`, without operands of three in any adder.

        A multiplier has no adder of its own here. So what is to be added to a sum is complete in a register
        one clock before, and `start` joins the third product two clocks before; with fewer products, the
        first.
        """
        pairs = list(operands)
        starts = 2 if len(pairs) > 2 else 0
        total = None
        for place, ((a, b), bound) in enumerate(zip(pairs, bounds, strict=True)):
            # Clocks that the product is there before the sum that it is added to.
            early = 0 if place == 0 else 2 if place == starts and start else 1
            for stage in range(wait + place - early):
                a = self.registered(m, advance, a, a.shape(), f"{name}_{place}_a{stage}")
                b = self.registered(m, advance, b, b.shape(), f"{name}_{place}_b{stage}")
            own, exact = self.sum_of_parts(m, advance, a, b, name=f"{name}_{place}"), (a * b).shape()
            if place == starts == 0:
                own = own + start
            for step in range(early):
                own = self.registered(m, advance, own, exact, f"{name}_{place}_own{step}")
                if place == starts and step == 0 and start:
                    own = own + start
                    exact = own.shape()
            shape = sum_shape(a * b, total, bound)
            total = own if total is None else own + total
            total = self.registered(m, advance, total, shape, f"{name}_{place}_p")
        return total

    def sum_of_parts(self, m: Module, advance: Signal, a, b, *, name: str):
        """The product of the operands of 2 clocks before: a register, or the sum of two.

        Raises ValueError beyond signed 35×18 bits.
        """
        if len(a) < len(b):
            a, b = b, a
        low_bits = OPERAND_BITS - 1
        signed_bits = [len(operand) + (not operand.shape().signed) for operand in (a, b)]
        if signed_bits[0] > OPERAND_BITS + low_bits or signed_bits[1] > OPERAND_BITS:
            raise ValueError(f"{name}: {len(a)} × {len(b)} bits: expected at most 35 × 18 signed")
        if signed_bits[0] <= OPERAND_BITS:
            return self.multiplier(m, advance, a, b, name=name)
        high = a[low_bits:].as_signed() if a.shape().signed else a[low_bits:]
        low = self.multiplier(m, advance, a[:low_bits], b, name=f"{name}_low")
        return low + (self.multiplier(m, advance, high, b, name=f"{name}_high") << low_bits)

    def registered(self, m: Module, advance: Signal, value, shape, name: str) -> Signal:
        """The value one clock later, in a register without a reset."""
        register = Signal(shape, reset_less=True, name=name)
        with m.If(advance):
            m.d.sync += register.eq(value)
        return register

    def multiplier(self, m: Module, advance: Signal, a, b, *, name: str) -> Signal:
        """One MULT18X18D with registered operands and output: the product 2 clocks later.

        The operands' registers are those of the logic before it, not the multiplier's own, which may be far
        away: so the way to the multiplier has a clock nearly for itself.
        """
        left, right = (
            self.registered(m, advance, operand, signed(OPERAND_BITS), f"{name}_{k}")
            for k, operand in zip("ab", (a, b), strict=True)
        )
        bits = range(OPERAND_BITS)
        output = Signal(signed(2 * OPERAND_BITS), name=f"{name}_m")
        m.submodules[f"{name}_multiplier"] = Instance(
            "MULT18X18D",
            p_REG_OUTPUT_CLK="CLK0",
            p_REG_OUTPUT_CE="CE0",
            p_REG_OUTPUT_RST="RST0",
            i_CLK0=ClockSignal(),
            i_CE0=advance,
            i_RST0=0,
            i_SIGNEDA=1,
            i_SIGNEDB=1,
            i_SOURCEA=0,
            i_SOURCEB=0,
            **{f"i_A{k}": left[k] for k in bits},
            **{f"i_B{k}": right[k] for k in bits},
            **{f"i_C{k}": 0 for k in bits},
            **{f"o_P{k}": output[k] for k in range(2 * OPERAND_BITS)},
        )
        return output
