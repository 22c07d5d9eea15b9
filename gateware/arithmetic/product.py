"""A pipelined product that synthesis maps to DSP slices: one, with all its registers, where operands fit."""

from amaranth import Signal

LATENCY = 3
"""Clocks with `advance` high from operands to product: registers of the operands (A, B), M and P."""


def product(m, platform, advance, a, b, *, name: str) -> Signal:
    """Multiply `a` and `b`, signed or unsigned; returns the product's register, valid after `LATENCY` clocks.

    advance : clock enable of all registers; they have no reset
    name : prefix of the registers' names

    Fits one DSP48E2 if one operand has at most 27 bits including its sign and the other at most 18, one
    DSP48E1 if one has at most 25. A wider product takes several (`DspSlice.slices`), whose results are added
    without a register between them: it is as exact, but not as fast. For a device with multipliers that no
    tool puts together, `platform` has a method `product` with these parameters and the same
    latency (see Ecp5).
    """
    if hasattr(platform, "product"):
        return platform.product(m, advance, a, b, name=name)
    left = Signal(a.shape(), reset_less=True, name=f"{name}_a")
    right = Signal(b.shape(), reset_less=True, name=f"{name}_b")
    multiplied = Signal((a * b).shape(), reset_less=True, name=f"{name}_m")
    held = Signal.like(multiplied, name=f"{name}_p")
    with m.If(advance):
        m.d.sync += [left.eq(a), right.eq(b), multiplied.eq(left * right), held.eq(multiplied)]
    return held
