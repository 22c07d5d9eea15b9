"""Product of a displacement and weights that change at bends: one multiplication for all of them."""

from amaranth import Module, Mux, Signal, Value, signed

from fastac.gateware.arithmetic.product import product
from fastac.gateware.arithmetic.shift_add import Term, canonical_signed_digits, partial_adder_tree


def offset_adders(slope_bits: int, bends: tuple[int, ...]) -> list[tuple[int, int]]:
    """How many additions make an offset, and of how many bits: what the slope changes by at the bends, then
    for each bend the multiples of that."""
    change_bits = slope_bits + 1
    multiples = [(len(canonical_signed_digits(bend)), change_bits + bend.bit_length()) for bend in bends]
    return [(len(bends), change_bits), *multiples]


def bent_product(
    m: Module, platform, advance, pixel: Value, slopes: list, bends: tuple[int, ...], *, bound: int, name: str
) -> Signal:
    """Σ_t weight_t · x_t of the terms that `integer.force.terms` makes of a pixel: slope · pixel + offset.

    pixel : signed displacement; slopes : of its segments, signed, in the order of `segment_slopes`
    bends : ascending, none below 0; bound : largest magnitude of the sum
    Registers, their clock enable `advance`, latency and `name` are those of `product`.

    The pixel's segment chooses the slope. The offset, minus the sum over the bends passed of bend · (what the
    slope changes by there), is added in the multiplier's own adder. It takes a clock for the changes and one
    for their multiples, which are shifts and additions: with n signed digits of all bends together, a tree of
    ceil(log2(n)) additions. Bends that are powers of two are the fastest.
    """
    band, *deep = bends
    inside, towards, away, *deeper = slopes
    outside, below = (pixel > band) | (pixel < -band), pixel < 0
    slope = Mux(outside, Mux(below, away, towards), inside)
    changes = [Mux(outside, Mux(below, away - inside, inside - towards), 0)]
    before = towards
    for bend, steeper in zip(deep, deeper, strict=True):
        passed = pixel > bend
        slope = Mux(passed, steeper, slope)
        changes.append(Mux(passed, before - steeper, 0))
        before = steeper

    parts = []
    for k, (bend, change) in enumerate(zip(bends, changes, strict=True)):
        held = Signal(signed(change.shape().width), reset_less=True, name=f"{name}_change{k}")
        with m.If(advance):
            m.d.sync += held.eq(change)
        parts += [
            Term(held, 1 << (len(held) - 1 + exponent), exponent, digit < 0)
            for exponent, digit in canonical_signed_digits(bend)
        ]
    offset = None
    if parts:  # the highest digit of a bend is positive, so that the sum is not negated
        levels = (len(parts) - 1).bit_length()
        [total] = partial_adder_tree(parts, levels, lambda term, _: term, name)
        value = total.value.shift_left(total.shift)
        offset = Signal(value.shape(), reset_less=True, name=f"{name}_offset")
        with m.If(advance):
            m.d.sync += offset.eq(value)
    return product(m, platform, advance, pixel, slope, addend=offset, bound=bound, name=name)
