"""Terms with shifts and signs, sums of them in pipelined trees, and the signed digits of constants.

There is at most one addition or subtraction between two registers.
"""

from collections.abc import Callable
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


def pipeline_register(m: Module) -> Register:
    """A function that registers a term: signed(signed_width(bound >> shift)), no clock enable, no reset."""

    def register(term: Term, name: str) -> Term:
        width = signed_width(term.bound >> term.shift)
        signal = Signal(signed(width), reset_less=True, name=name)
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
