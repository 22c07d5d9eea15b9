# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from ecp5_model import ModelledEcp5
from paused_pipeline import outputs

from fastac.gateware.arithmetic.product import sum_shape
from fastac.gateware.arithmetic.product_cascade import cascade_latency, product_cascade
from fastac.models.integer.words import signed_width

A, B = 27, 18


class Cascade(wiring.Component):
    """A component around `product_cascade`."""

    def __init__(self, length, start, wait):
        self.length, self.start, self.wait = length, start, wait
        self.bounds = [(k + 1 << A + B - 2) + start for k in range(length)]
        super().__init__(
            {
                "advance": In(1),
                "a": In(data.ArrayLayout(signed(A), length)),
                "b": In(data.ArrayLayout(signed(B), length)),
                "o": Out(signed(max(signed_width(self.bounds[-1]), A + B))),
            }
        )

    def elaborate(self, platform):
        m = Module()
        pairs = [(self.a[k], self.b[k]) for k in range(self.length)]
        keys = {"start": self.start, "wait": self.wait, "name": "products"}
        total = product_cascade(m, platform, self.advance, pairs, self.bounds, **keys)
        assert total.shape() == self.o.shape()
        m.d.comb += self.o.eq(total)
        return m


@pytest.mark.parametrize("platform", [None, ModelledEcp5()], ids=["DSP48E2", "ECP5"])
@pytest.mark.parametrize(("length", "start", "wait"), [(3, 5, 2), (4, 0, 0), (2, 5, 1), (1, 5, 0)])
def test_every_sum_after_the_cascade_s_clocks(platform, length, start, wait):
    dut = Cascade(length, start, wait)
    rng = np.random.default_rng(1)
    low = np.array([-(1 << width - 1) for width in (A, B)])
    high = -low - 1
    corners = [[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]
    rows = [[corner] * length for corner in corners]  # the limits of the sums
    rows += rng.integers(low, high + 1, (60, length, 2)).tolist()
    expected = [start + sum(x * y for x, y in np.array(row).tolist()) for row in rows]
    assert max(expected) == dut.bounds[-1]
    latency = cascade_latency(length) + wait
    pauses = rng.random(900) < 0.4

    def drive(ctx, row):
        ctx.set(dut.a, [int(x) for x, _ in row])
        ctx.set(dut.b, [int(y) for _, y in row])

    found = outputs(dut, platform, rows, drive, latency=latency, pauses=pauses)
    assert found == expected


def test_a_sum_is_as_wide_as_its_bound_and_its_product():
    product, addend = Signal(signed(8)), Signal(8)
    assert sum_shape(product, None, None) == signed(8)
    assert sum_shape(product, addend, None) == signed(10)
    assert sum_shape(product, addend, 300) == signed(10)
    assert sum_shape(product, addend, 3) == signed(8)
