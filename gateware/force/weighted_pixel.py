"""A pixel of a weighted sum: one value, several, or a displacement with bends."""

from dataclasses import dataclass

from amaranth import Mux, Shape, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.force import WeightedSum


def products_of(bends: int) -> int:
    """How many products a folded sum takes of a displacement with so many bends: one for itself and one for
    each bend, as of what is beyond the band on either side one is 0."""
    return 1 + bends


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
    def products(self) -> int:
        """Products of a pixel for each axis in a folded sum, as many as `values` has."""
        return products_of(len(self.bends)) if self.bends else self.terms

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

    def values(self, pixel) -> list:
        """What a folded sum multiplies of a pixel of the stream `i`."""
        if self.bends:
            band, *deep = self.bends
            beyond = Mux(pixel > band, pixel - band, Mux(pixel < -band, pixel + band, 0))
            return [pixel, beyond, *(Mux(pixel > bend, pixel - bend, 0) for bend in deep)]
        return [pixel] if self.terms == 1 else list(pixel)
