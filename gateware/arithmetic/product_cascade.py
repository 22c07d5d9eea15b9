"""A sum of a few products in a cascade of DSP slices, whose adders replace those of an adder tree."""

from collections.abc import Iterable, Sequence

from amaranth import Const, Signal

from fastac.gateware.arithmetic.product import LATENCY, product


def cascade_latency(length: int) -> int:
    """Clocks with `advance` high from the operands to the sum of `length` products, without a wait."""
    return LATENCY + length - 1


def product_cascade(
    m, platform, advance, operands: Iterable, bounds: Sequence[int], *, start=0, wait=0, name: str
) -> Signal:
    """Sum of `start` and the products of `operands`, pairs as `product` takes; the last product's register.

    bounds : for every product, the largest magnitude of the sum of `start` and the products up to it
    start : constant that the first product's slice adds
    wait : clocks before the first product, for a sum that is to come together with longer ones
    name : prefix of the registers' names

    Each product's operands wait one clock longer than the one's before, so that it is added to a sum that is
    already there: on AMD's devices in the slice's own adder, of 48 bits (Xilinx UG579, "Cascading DSP
    slices"). The first wait is in the slice, too, which has two registers for each operand. For a device
    whose multipliers have no adders, `platform` has a method `product_cascade` with these parameters and the
    same latency (see Ecp5).
    """
    if hasattr(platform, "product_cascade"):
        return platform.product_cascade(m, advance, operands, bounds, start=start, wait=wait, name=name)
    total = Const(start) if start else None
    for place, ((a, b), bound) in enumerate(zip(operands, bounds, strict=True)):
        for stage in range(wait + place):
            a = _delayed(m, advance, a, f"{name}_{place}_a{stage}")
            b = _delayed(m, advance, b, f"{name}_{place}_b{stage}")
        total = product(m, platform, advance, a, b, addend=total, bound=bound, name=f"{name}_{place}")
    return total


def _delayed(m, advance, value, name: str) -> Signal:
    register = Signal(value.shape(), reset_less=True, name=name)
    with m.If(advance):
        m.d.sync += register.eq(value)
    return register
