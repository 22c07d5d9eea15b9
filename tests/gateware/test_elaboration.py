import gc

import pytest
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from gateware.elaboration import to_rtlil, to_verilog


class Watcher(wiring.Component):
    """A counter that notes whether the cyclic collector runs while it is elaborated."""

    count: Out(4)

    def __init__(self, error: Exception | None = None):
        super().__init__()
        self.error = error

    def elaborate(self, platform):
        self.collecting, self.platform = gc.isenabled(), platform
        if self.error:
            raise self.error
        m = Module()
        m.d.sync += self.count.eq(self.count + 1)
        return m


@pytest.fixture(params=(True, False))
def enabled(request):
    before = gc.isenabled()
    (gc.enable if request.param else gc.disable)()
    yield request.param
    (gc.enable if before else gc.disable)()


@pytest.mark.parametrize(
    ("convert", "head"), [(to_verilog, "module counter("), (to_rtlil, "module \\counter")]
)
def test_collector_rests_only_while_the_design_is_elaborated(convert, head, enabled):
    design, platform = Watcher(), object()
    text = convert(design, name="counter", platform=platform)
    assert head in text
    assert "count" in text
    assert __file__ not in text
    assert design.collecting is False
    assert design.platform is platform
    assert gc.isenabled() == enabled


@pytest.mark.parametrize("convert", [to_verilog, to_rtlil])
def test_collector_is_back_after_a_faulty_design(convert, enabled):
    with pytest.raises(ArithmeticError, match="no such width"):
        convert(Watcher(ArithmeticError("no such width")))
    assert gc.isenabled() == enabled
