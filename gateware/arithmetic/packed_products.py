"""Two products with a shared operand in one multiplier: (upper << shift) + lower, times x."""

from collections.abc import Sequence
from dataclasses import dataclass

from amaranth import Cat, Const, Value, unsigned

from fastac.models.integer.words import signed_width

WIDE_PORT, NARROW_PORT = 27, 18
"""Bits of the two signed operands of a DSP48E2's multiplier."""


@dataclass(frozen=True)
class Packing:
    """How two weights of at most ±`weight_limit` share a word, and how many products a word can sum.

    Sums of 2**`levels` products stay inside the lower field of `shift` bits. That field is signed, so where
    it is negative it has borrowed one from the upper field, which then needs one more: the correction.
    """

    weight_limit: int
    shift: int
    levels: int

    @property
    def limit(self) -> int:
        """The largest magnitude of a packed word."""
        return (self.weight_limit << self.shift) + self.weight_limit

    @property
    def width(self) -> int:
        """Bits of a packed word."""
        return signed_width(self.limit)

    def word(self, lower: int, upper: int) -> int:
        return (upper << self.shift) + lower

    def split(self, total: Value, lower_bias: Value, upper_bias: Value) -> tuple[Value, Value]:
        """A sum of packed products as (lower, upper) sum, each with its signed bias: one addition each.

        The correction is the carry into the upper addition.
        """
        lower = total[: self.shift].as_signed()
        carry = Cat(Const(1, unsigned(1)), total[self.shift :]).as_signed()
        carry += Cat(total[self.shift - 1], upper_bias).as_signed()
        return lower + lower_bias, carry >> 1


def best_packing(weight_limit: int, input_limit: Sequence[int], input_width: int) -> Packing | None:
    """The packing that sums the most products in a word; None where two products do not fit a DSP48E2.

    input_limit : largest magnitude of each input, in the order in which they are summed
    input_width : bits of an input with its sign
    """
    if input_width > NARROW_PORT:
        return None
    limits = [int(limit) for limit in input_limit]
    for levels in range((len(limits) - 1).bit_length(), -1, -1):
        reached = max(
            sum(limits[start : start + (1 << levels)]) for start in range(0, len(limits), 1 << levels)
        )
        found = Packing(weight_limit, signed_width(weight_limit * reached), levels)
        if found.width <= WIDE_PORT:
            return found
    return None
