"""Two products with a common operand x in one multiplier: ((upper << shift) + lower) · x.

The method is that of Xilinx WP486, "Deep Learning with INT8 Optimization on Xilinx Devices" (2016).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from amaranth import Cat, Const, Value, unsigned

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.models.integer.words import signed_width


@dataclass(frozen=True)
class Packing:
    """How two weights of magnitude up to `weight_limit` share one word, and how many products it can sum.

    The lower field has `shift` bits, enough for the sum of 2**`levels` products. It is signed: a negative
    lower field borrows 1 from the upper field, and `split` corrects that by adding 1.
    """

    weight_limit: int
    shift: int
    levels: int

    @property
    def limit(self) -> int:
        """Largest magnitude of a packed word."""
        return (self.weight_limit << self.shift) + self.weight_limit

    @property
    def width(self) -> int:
        """Bits of a packed word."""
        return signed_width(self.limit)

    def word(self, lower: int, upper: int) -> int:
        """The two weights packed into one word."""
        return (upper << self.shift) + lower

    def split(self, total: Value, lower_bias: Value, upper_bias: Value) -> tuple[Value, Value]:
        """Split a sum of packed products into its (lower, upper) sums and add a signed bias to each.

        Costs one addition each: the correction of the borrow is the carry into the upper one.
        """
        lower = total[: self.shift].as_signed()
        carry = Cat(Const(1, unsigned(1)), total[self.shift :]).as_signed()
        carry += Cat(total[self.shift - 1], upper_bias).as_signed()
        return lower + lower_bias, carry >> 1


def best_packing(
    weight_limit: int, input_limit: Sequence[int], input_width: int, dsp: DspSlice = DSP48E2
) -> Packing | None:
    """The packing that sums the most products per word, or None if two products do not fit in a DSP slice.

    weight_limit : largest magnitude of a weight
    input_limit : largest magnitude of each input, in the order in which their products are summed
    input_width : bits of an input including its sign

    A word of two weights of w bits, for products of p bits, has p + w bits. With 8-bit weights, 27 bits hold
    inputs of 11 bits, sign included, and 25 bits inputs of 10.
    """
    if input_width > dsp.narrow_port:
        return None
    limits = [int(limit) for limit in input_limit]
    for levels in range((len(limits) - 1).bit_length(), -1, -1):
        reached = max(
            sum(limits[start : start + (1 << levels)]) for start in range(0, len(limits), 1 << levels)
        )
        found = Packing(weight_limit, signed_width(weight_limit * reached), levels)
        if found.width <= dsp.wide_port:
            return found
    return None
