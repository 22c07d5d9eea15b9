"""Small constant multiples by shifts and additions, for which synthesis would take multipliers."""

from amaranth import Const, Value, ValueCastable

from fastac.gateware.arithmetic.shift_add import canonical_signed_digits


def multiple(value: Value | ValueCastable, factor: int) -> Value:
    """`value` times `factor`, an addition or a subtraction for each further signed digit; not registered."""
    total = Const(0, 1)
    for exponent, digit in canonical_signed_digits(factor):
        term = Value.cast(value).shift_left(exponent)
        total = total + term if digit > 0 else total - term
    return total
