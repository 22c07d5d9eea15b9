"""A product in the registers of a DSP slice."""

from amaranth import Signal

LATENCY = 3
"""Advances from operands to their product: the operands' registers, the multiplier's and the output's."""


def product(m, platform, advance, a, b, *, name: str) -> Signal:
    """The register that holds `a` · `b`, of values of any sign, `LATENCY` advances later; no reset.

    One DSP48E2 with all its registers where one has at most 27 signed bits and the other 18. A device with
    narrower multipliers forms the product in its own way, in as many advances: its platform has a method
    `product` with these parameters.
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
