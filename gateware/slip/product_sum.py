"""Registers of a sum of products that takes a bit of a factor in each clock, where time does not matter."""

from amaranth import Const, Mux, Signal


class ProductSum:
    """Registers of Σ ± a · b, a and b of any sign; the methods give what is assigned to them.

    total : the sum so far, in `bits` bits and modulo 2**bits
    only_adds : no product is subtracted, and no b is negative
    """

    def __init__(self, name: str, bits: int, *, factor_bits: int, only_adds: bool = False):
        self.only_adds = only_adds
        self.total = Signal(bits, name=f"{name}_total", reset_less=True)
        self.shifted = Signal(bits, name=f"{name}_shifted", reset_less=True)
        self.factor = Signal(factor_bits, name=f"{name}_factor", reset_less=True)
        if not only_adds:
            self.minus = Signal(name=f"{name}_minus", reset_less=True)

    def load(self, a, b, *, minus: bool = False, afresh: bool = False) -> list:
        """Begin to add a · b, or to subtract it; `afresh` makes it the first product of the sum."""
        negative, magnitude = Const(0, 1), b
        if b.shape().signed:
            negative, magnitude = b < 0, Mux(b < 0, -b, b)
        begun = [self.shifted.eq(a), self.factor.eq(magnitude)]
        if not self.only_adds:
            begun.append(self.minus.eq(~negative if minus else negative))
        return [*begun, self.total.eq(0)] if afresh else begun

    def step(self) -> list:
        """Take one bit of the factor."""
        counts = self.factor[0]
        minus = Const(0, 1) if self.only_adds else self.minus & counts
        bits = len(self.shifted)
        # To subtract is to add what all bits inverted are, and 1.
        term = (self.shifted ^ minus.replicate(bits)) & counts.replicate(bits)
        return [
            self.total.eq(self.total + term + minus),
            self.shifted.eq(self.shifted << 1),
            self.factor.eq(self.factor >> 1),
        ]
