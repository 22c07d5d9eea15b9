"""Multiplication by constants without multipliers: shifts and pipelined additions.

There is at most one addition or subtraction between two registers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from amaranth import Module, Signal, Value, signed

from fastac.models.integer.words import signed_width


def canonical_signed_digits(constant: int) -> list[tuple[int, int]]:
    """The canonical signed-digit form of `constant`: (exponent, ±1) of its non-zero digits, lowest first.

    No two non-zero digits are adjacent, and no signed-digit form has fewer: at most ceil(n/2) for a signed
    constant of n bits (G. W. Reitwiesner, "Binary arithmetic", Advances in Computers 1, 1960).
    """
    digits, exponent = [], 0
    while constant:
        if constant & 1:
            digit = 2 - (constant & 3)
            digits.append((exponent, digit))
            constant -= digit
        constant >>= 1
        exponent += 1
    return digits


@dataclass(frozen=True)
class Term:
    """A term of a sum: `value << shift`, negated if `negative`; its magnitude is at most `bound`.

    Shift and sign are applied only in the next addition, where the sign makes it a subtraction at no cost.
    """

    value: Value
    bound: int
    shift: int = 0
    negative: bool = False

    def plus(self, other: "Term", bound: int) -> "Term":
        """The sum of two terms, by one addition or subtraction; its magnitude is at most `bound`."""
        first, second = (other, self) if self.negative else (self, other)
        shift = min(first.shift, second.shift)
        # shift_left() instead of `<<`: that would widen the result for the largest amount of as many bits.
        left, right = (term.value.shift_left(term.shift - shift) for term in (first, second))
        subtract = second.negative and not first.negative
        return Term(left - right if subtract else left + right, bound, shift, first.negative)


Register = Callable[[Term, str], Term]
"""Function of a term and a name that returns the term one clock later."""


def pipeline_register(m: Module, enable: Value) -> Register:
    """A function that registers a term: signed(signed_width(bound >> shift)), clock enable, no reset."""

    def register(term: Term, name: str) -> Term:
        width = signed_width(term.bound >> term.shift)
        signal = Signal(signed(width), reset_less=True, name=name)
        with m.If(enable):
            m.d.sync += signal.eq(term.value)
        return replace(term, value=signal)

    return register


def partial_adder_tree(terms: list[Term], levels: int, register: Register, name: str) -> list[Term]:
    """Adder tree of `levels` levels, a register each: the sums of every 2**`levels` neighbouring terms."""
    for level in range(levels):
        pairs = [terms[start : start + 2] for start in range(0, len(terms), 2)]
        terms = [
            register(
                pair[0].plus(pair[1], pair[0].bound + pair[1].bound) if len(pair) == 2 else pair[0],
                f"{name}_{level}_{j}",
            )
            for j, pair in enumerate(pairs)
        ]
    return terms


def constant_product(constant: int, taps: Sequence[Value], limit: int, register: Register, name: str) -> Term:
    """The product `constant` · x, aligned in time with the last of `taps`.

    constant : not 0
    taps : x, then x delayed by 1, 2, … clocks; at least 1 + ceil(log2(digits)) of them, for the levels of
        additions
    limit : largest magnitude of x

    Additions happen as late as possible, because all products of x share its delays.
    """

    def build(digits: list[tuple[int, int]], time: int) -> Term:
        if len(digits) == 1:
            [(exponent, sign)] = digits
            return Term(taps[time], limit << exponent, exponent, sign < 0)
        half = len(digits) // 2
        bound = abs(sum(sign << exponent for exponent, sign in digits)) * limit
        low, high = build(digits[:half], time - 1), build(digits[half:], time - 1)
        return register(low.plus(high, bound), f"{name}_at{time}")

    digits = canonical_signed_digits(constant)
    if (len(digits) - 1).bit_length() >= len(taps):
        raise ValueError(
            f"constant {constant} of {len(digits)} digits: expected at most {1 << len(taps) - 1}"
        )
    return build(digits, len(taps) - 1)
