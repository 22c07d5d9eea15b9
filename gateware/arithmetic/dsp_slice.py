"""The multipliers of AMD's DSP slices: what fits one, and how many a wider product takes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DspSlice:
    """A slice with a signed multiplier of `wide_port` × `narrow_port` bits and a 48-bit accumulator."""

    name: str
    wide_port: int
    narrow_port: int = 18

    def slices(self, a: int, b: int) -> int:
        """Number of slices of a product of signed `a` × `b` bits, with either operand on either port.

        An operand wider than its port is cut into a signed upper part and unsigned lower parts one bit
        narrower than the port: on 27 × 18 bits ceil((a − 1)/26) · ceil((b − 1)/17), or with the ports
        exchanged if that is less.
        """

        def parts(width: int, port: int) -> int:
            return max(1, -(-(width - 1) // (port - 1)))

        wide, narrow = self.wide_port, self.narrow_port
        return min(parts(a, wide) * parts(b, narrow), parts(b, wide) * parts(a, narrow))


DSP48E2 = DspSlice("DSP48E2", 27)
"""Of UltraScale+ (Xilinx UG579, "Multiplier")."""
DSP48E1 = DspSlice("DSP48E1", 25)
"""Of the 7 series (Xilinx UG479, "Two's Complement Multiplier")."""
