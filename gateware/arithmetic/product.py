"""A pipelined product that synthesis maps to DSP slices: one, with all its registers, where operands fit."""

from amaranth import Shape, Signal, signed

from fastac.models.integer.words import signed_width

LATENCY = 3
"""Clocks with `advance` high from operands to product: registers of the operands (A, B), M and P."""


def product(m, platform, advance, a, b, *, addend=None, bound: int | None = None, name: str) -> Signal:
    """Multiply `a` and `b`, signed or unsigned; returns the product's register, valid after `LATENCY` clocks.

    advance : clock enable of all registers; they have no reset
    addend : what is added to the product in its last register, if any: a value that is there `LATENCY` - 1
        clocks after the operands
    bound : largest magnitude of the sum, if it is less than its operands' widths tell; its register is never
        narrower than the product
    name : prefix of the registers' names

    Fits one DSP48E2 if one operand has at most 27 bits including its sign and the other at most 18, one
    DSP48E1 if one has at most 25. A wider product takes several (`DspSlice.slices`), whose results are added
    without a register between them: it is as exact, but not as fast. For a device with multipliers that no
    tool puts together, `platform` has a method `product` with these parameters and the same
    latency (see Ecp5).
    """
    if hasattr(platform, "product"):
        return platform.product(m, advance, a, b, addend=addend, bound=bound, name=name)
    left = Signal(a.shape(), reset_less=True, name=f"{name}_a")
    right = Signal(b.shape(), reset_less=True, name=f"{name}_b")
    multiplied = Signal((a * b).shape(), reset_less=True, name=f"{name}_m")
    held = Signal(sum_shape(multiplied, addend, bound), reset_less=True, name=f"{name}_p")
    total = multiplied if addend is None else multiplied + addend
    with m.If(advance):
        m.d.sync += [left.eq(a), right.eq(b), multiplied.eq(left * right), held.eq(total)]
    return held


def sum_shape(multiplied, addend, bound: int | None) -> Shape:
    """Shape of the last register of `product`: of `multiplied`, with `addend` unless it is None."""
    if bound is None:
        return (multiplied if addend is None else multiplied + addend).shape()
    shape = multiplied.shape()
    return signed(max(shape.width + (not shape.signed), signed_width(bound)))
