# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, Shape, Signal
from amaranth.hdl import Fragment
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out
from ecp5_model import ModelledEcp5
from paused_pipeline import outputs

from fastac.gateware.arithmetic.product import LATENCY, product
from fastac.gateware.target.ecp5 import Ecp5


class Multiplier(wiring.Component):
    """A component around `product`."""

    def __init__(self, a: Shape, b: Shape):
        super().__init__(
            {"advance": In(1), "a": In(a), "b": In(b), "o": Out((Signal(a) * Signal(b)).shape())}
        )

    def elaborate(self, platform):
        m = Module()
        m.d.comb += self.o.eq(product(m, platform, self.advance, self.a, self.b, name="product"))
        return m


def limits(shape: Shape) -> list[int]:
    low = -(1 << shape.width - 1) if shape.signed else 0
    return [low, low + 1, low + (1 << shape.width) - 2, low + (1 << shape.width) - 1]


@pytest.mark.parametrize("platform", [None, ModelledEcp5()], ids=["DSP48E2", "ECP5"])
@pytest.mark.parametrize(
    ("a", "b"),
    [
        (Shape(27, True), Shape(18, True)),
        (Shape(17, True), Shape(27, True)),
        (Shape(26, False), Shape(17, False)),
        (Shape(18, True), Shape(17, False)),
        (Shape(18, False), Shape(3, True)),
    ],
    ids=repr,
)
def test_every_product_after_three_clocks(platform, a, b):
    rng = np.random.default_rng(1)
    pairs = [(x, y) for x in limits(a) for y in limits(b)]
    pairs += [
        (int(rng.integers(limits(a)[0], limits(a)[3])), int(rng.integers(limits(b)[0], limits(b)[3])))
        for _ in range(50)
    ]
    pauses = rng.random(500) < 0.4
    dut = Multiplier(a, b)

    def drive(ctx, pair):
        x, y = pair
        ctx.set(dut.a, x)
        ctx.set(dut.b, y)

    found = outputs(dut, platform, pairs, drive, latency=LATENCY, pauses=pauses)
    assert found == [x * y for x, y in pairs]


def test_operands_too_wide_for_the_ecp5():
    with pytest.raises(ValueError, match="product: 36 × 18 bits: expected at most 35 × 18 signed"):
        Fragment.get(Multiplier(Shape(36, False), Shape(18, True)), Ecp5())
