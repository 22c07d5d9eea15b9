"""A pixel of a weighted sum: one value, several, or a displacement with bends."""

from dataclasses import dataclass

from amaranth import Shape, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.force import WeightedSum


@dataclass(frozen=True, eq=False)
class WeightedPixel:
    """What the hardware of `weighted` takes of a pixel.

    bends : of a displacement whose terms follow from it as `integer.force.terms` says; else ()
    Raises ValueError where the weights are not of a signed value with these bends.
    """

    weighted: WeightedSum
    bends: tuple[int, ...] = ()

    def __post_init__(self):
        if self.bends and (self.terms != len(self.bends) + 2 or not self.weighted.input_signed):
            raise ValueError(
                f"bends {self.bends}: {self.terms} terms: expected {len(self.bends) + 2} of a signed value"
            )

    @property
    def terms(self) -> int:
        """Weights of a pixel for each axis."""
        return self.weighted.weight.shape[3]

    @property
    def value(self) -> Shape:
        """Of a value."""
        return Shape(self.weighted.input_width, self.weighted.input_signed)

    def members(self, lanes: int, *, loadable: bool) -> dict[str, wiring.Member]:
        """The ports `i`, `o` and, with `loadable`, `constant` of a sum of `lanes` pixels a beat."""
        several = not self.bends and self.terms > 1
        pixel = data.ArrayLayout(self.value, self.terms) if several else self.value
        sums = data.ArrayLayout(signed(self.weighted.width), len(self.weighted.weight))
        members = {
            "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
            "o": Out(stream.Signature(sums)),
        }
        return members | ({"constant": In(sums)} if loadable else {})
