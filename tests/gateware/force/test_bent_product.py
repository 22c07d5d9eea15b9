# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from ecp5_model import ModelledEcp5
from paused_pipeline import outputs

from fastac.gateware.arithmetic.product import LATENCY
from fastac.gateware.force.bent_product import bent_product
from fastac.models.integer.force import terms
from fastac.models.integer.force_segments import largest, segment_slopes
from fastac.models.integer.words import signed_width

BITS, LIMIT = 7, 63


class BentProduct(wiring.Component):
    """A component around `bent_product`: `o` is its register, cut to the bits of `bound`."""

    def __init__(self, bends, slope_bits: int, bound: int):
        self.bends, self.bound = bends, bound
        slopes = data.ArrayLayout(signed(slope_bits), 2 + len(bends))
        super().__init__(
            {
                "advance": In(1),
                "pixel": In(signed(BITS)),
                "slopes": In(slopes),
                "o": Out(signed(signed_width(bound))),
            }
        )

    def elaborate(self, platform):
        m = Module()
        slopes = [self.slopes[k] for k in range(2 + len(self.bends))]
        found = bent_product(
            m, platform, self.advance, self.pixel, slopes, self.bends, bound=self.bound, name="product"
        )
        m.d.comb += self.o.eq(found[: len(self.o)].as_signed())
        return m


@pytest.mark.parametrize("platform", [None, ModelledEcp5()], ids=["DSP48E2", "ECP5"])
@pytest.mark.parametrize(
    "bends",
    [(21, 22, 53), (8, 32), (0,), (0, 1), (8,), (11, 43), (LIMIT,)],
    ids=lambda bends: "/".join(map(str, bends)),
)
def test_every_displacement_after_three_clocks(platform, bends):
    """Bends of one signed digit and of several, with weights all alike, alone and random."""
    rng = np.random.default_rng(1)
    count, most = 2 + len(bends), 25
    kinds = [most * np.eye(count, dtype=int), [[-most] * count], rng.integers(-most, most + 1, (3, count))]
    weights = np.concatenate(kinds)
    slopes = segment_slopes(weights)
    bound = int(largest(weights, bends, LIMIT).max())
    cases = [(k, d) for k in range(len(weights)) for d in range(-LIMIT, LIMIT + 1)]
    expected = [int(terms(np.array(d), bends) @ weights[k]) for k, d in cases]
    assert max(map(abs, expected)) == bound
    dut = BentProduct(bends, signed_width(int(np.abs(slopes).max())), bound)

    def drive(ctx, case):
        k, d = case
        ctx.set(dut.pixel, d)
        ctx.set(dut.slopes, slopes[k].tolist())

    found = outputs(dut, platform, cases, drive, latency=LATENCY, pauses=rng.random(4 * len(cases)) < 0.3)
    assert found == expected
