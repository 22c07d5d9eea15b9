"""Products with constants as shifts and additions, one addition or subtraction between registers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from amaranth import Module, Signal, Value, signed

from fastac.models.integer.words import signed_width


def canonical_signed_digits(constant: int) -> list[tuple[int, int]]:
    """`constant` as (exponent, ±1) of powers of two, lowest first, no two of them neighbours.

    No other signed-digit form has fewer digits: a constant of n bits with its sign has at most ceil(n/2).
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
    """`value << shift`, less than nothing where `negative`; at most `bound` in magnitude.

    A sign that has not been applied costs nothing: the next addition becomes a subtraction.
    """

    value: Value
    bound: int
    shift: int = 0
    negative: bool = False

    def plus(self, other: "Term", bound: int) -> "Term":
        """The sum of two terms, at most `bound` in magnitude; one addition or subtraction."""
        first, second = (other, self) if self.negative else (self, other)
        shift = min(first.shift, second.shift)
        # Amaranth takes the amount of a `<<` for a variable and makes room for the largest of as many bits.
        left, right = (term.value.shift_left(term.shift - shift) for term in (first, second))
        subtract = second.negative and not first.negative
        return Term(left - right if subtract else left + right, bound, shift, first.negative)


Register = Callable[[Term, str], Term]


def pipeline_register(m: Module, enable: Value) -> Register:
    """A function that returns its term one enabled clock later, in the bits that it needs; no reset."""

    def register(term: Term, name: str) -> Term:
        width = signed_width(term.bound >> term.shift)
        signal = Signal(signed(width), reset_less=True, name=name)
        with m.If(enable):
            m.d.sync += signal.eq(term.value)
        return replace(term, value=signal)

    return register


def partial_adder_tree(terms: list[Term], levels: int, register: Register, name: str) -> list[Term]:
    """The sums of 2**`levels` neighbouring terms, or of what is left; a register at every level."""
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
    """`constant`, not 0, times x, in time with the last of `taps`: x, then x one register later each.

    |x| <= limit. Taps for ceil(log2(digits)) levels of additions are needed; the sums start as late as they
    can, because delays of x are shared by all its products.
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
