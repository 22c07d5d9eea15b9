"""Lattice ECP5 as an elaboration platform: products in its registered 18×18-bit multipliers."""

from amaranth import ClockSignal, Instance, Module, Signal, signed

from fastac.gateware.arithmetic.product import sum_shape

OPERAND_BITS = 18
"""Bits of each operand of a MULT18X18D, signed."""


class Ecp5:
    """Platform whose method `product` replaces `gateware.arithmetic.product.product` on an ECP5.

    An operand wider than 18 bits is cut into its 17 lowest bits, unsigned, and the rest. The two products
    are added after the multipliers' output registers. The latency is that of one DSP48E2: 3 clocks.
    """

    def product(
        self, m: Module, advance: Signal, a, b, *, addend=None, bound: int | None = None, name: str
    ) -> Signal:
        """As `gateware.arithmetic.product.product`; ValueError beyond signed 35×18 bits."""
        if len(a) < len(b):
            a, b = b, a
        low_bits = OPERAND_BITS - 1
        signed_bits = [len(operand) + (not operand.shape().signed) for operand in (a, b)]
        if signed_bits[0] > OPERAND_BITS + low_bits or signed_bits[1] > OPERAND_BITS:
            raise ValueError(f"{name}: {len(a)} × {len(b)} bits: expected at most 35 × 18 signed")
        if signed_bits[0] <= OPERAND_BITS:
            total = self.multiplier(m, advance, a, b, name=name)
        else:
            high = a[low_bits:].as_signed() if a.shape().signed else a[low_bits:]
            low = self.multiplier(m, advance, a[:low_bits], b, name=f"{name}_low")
            total = low + (self.multiplier(m, advance, high, b, name=f"{name}_high") << low_bits)
        if addend is not None:
            total = total + addend
        held = Signal(sum_shape(a * b, addend, bound), reset_less=True, name=f"{name}_p")
        with m.If(advance):
            m.d.sync += held.eq(total)
        return held

    def multiplier(self, m: Module, advance: Signal, a, b, *, name: str) -> Signal:
        """One MULT18X18D with registered operands and output: the product 2 clocks later."""
        bits = range(OPERAND_BITS)
        left, right = (Signal(signed(OPERAND_BITS), name=f"{name}_{k}") for k in "ab")
        output = Signal(signed(2 * OPERAND_BITS), name=f"{name}_m")
        m.d.comb += [left.eq(a), right.eq(b)]
        clocked = {
            f"p_REG_{where}_{what}": value
            for where in ("INPUTA", "INPUTB", "OUTPUT")
            for what, value in (("CLK", "CLK0"), ("CE", "CE0"), ("RST", "RST0"))
        }
        m.submodules[f"{name}_multiplier"] = Instance(
            "MULT18X18D",
            **clocked,
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
