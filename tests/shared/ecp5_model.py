"""An elaboration platform for the ECP5 whose multipliers a simulator can run."""

from amaranth import Signal

from fastac.gateware.target.ecp5 import OPERAND_BITS, Ecp5


class ModelledEcp5(Ecp5):
    """Ecp5 with a behavioural model of MULT18X18D in place of the primitive, for simulation."""

    def multiplier(self, m, advance, a, b, *, name):
        for operand in (a, b):
            assert len(operand) + (not operand.shape().signed) <= OPERAND_BITS
        left, right = Signal(a.shape(), name=f"{name}_a"), Signal(b.shape(), name=f"{name}_b")
        output = Signal((a * b).shape(), name=f"{name}_m")
        with m.If(advance):
            m.d.sync += [left.eq(a), right.eq(b), output.eq(left * right)]
        return output
