# amaranth: UnusedElaboratable=no
import gc
import re

import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.target.elaboration import shared_instances, to_rtlil, to_verilog


class GcProbe(wiring.Component):
    """A counter that records whether the cyclic garbage collector is enabled during its elaboration."""

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
def test_garbage_collector_is_paused_only_during_elaboration(convert, head, enabled):
    design, platform = GcProbe(), object()
    text = convert(design, name="counter", platform=platform)
    assert head in text
    assert "count" in text
    assert __file__ not in text
    assert design.collecting is False
    assert design.platform is platform
    assert gc.isenabled() == enabled


@pytest.mark.parametrize("convert", [to_verilog, to_rtlil])
def test_garbage_collector_is_restored_after_an_error(convert, enabled):
    with pytest.raises(ArithmeticError, match="no such width"):
        convert(GcProbe(ArithmeticError("no such width")))
    assert gc.isenabled() == enabled


class Delay(wiring.Component):
    """Input delayed by two clocks: one register, with a reset if `resets`, and two shared Inverters."""

    def __init__(self, *, resets: bool = False, name: str = "inner"):
        super().__init__({"i": In(data.ArrayLayout(4, 2)), "o": Out(data.ArrayLayout(4, 2))})
        self.resets, self.name = resets, name

    def elaborate(self, platform):
        m = Module()
        held = Signal(8, reset_less=not self.resets)
        inner = [Inverter(), Inverter()]
        for k, submodule in enumerate(shared_instances(inner, self.name)):
            m.submodules[f"inner{k}"] = submodule
            m.d.comb += [inner[k].i.eq(held.word_select(k, 4)), self.o[k].eq(inner[k].o)]
        m.d.sync += held.eq(self.i)
        return m


class Inverter(wiring.Component):
    """Inverted input, one clock later."""

    i: In(4)
    o: Out(4)

    def elaborate(self, platform):
        m = Module()
        held = Signal(4, reset_less=True)
        m.d.sync += held.eq(~self.i)
        m.d.comb += self.o.eq(held)
        return m


class Delays(wiring.Component):
    """Several `Delay`s side by side."""

    def __init__(self, count: int, **delay):
        bus = data.ArrayLayout(data.ArrayLayout(4, 2), count)
        super().__init__({"i": In(bus), "o": Out(bus)})
        self.delays = [Delay(**delay) for _ in range(count)]

    def elaborate(self, platform):
        m = Module()
        for k, (delay, submodule) in enumerate(
            zip(self.delays, shared_instances(self.delays, "delay"), strict=True)
        ):
            m.submodules[f"delay{k}"] = submodule
            m.d.comb += [delay.i.eq(self.i[k]), self.o[k].eq(delay.o)]
        return m


def test_identical_components_share_a_module():
    text = to_rtlil(Delays(3), name="design")
    assert re.findall(r"^module (\S+)$", text, re.MULTILINE) == [
        "\\design",
        "\\design.shared.delay",
        "\\design.shared.inner",
    ]
    assert text.count("attribute \\top 1") == 1
    cells = re.findall(r"^  cell (\\\S+) (\S+)$", text, re.MULTILINE)
    assert cells == [
        *(("\\design.shared.delay", f"\\delay{k}") for k in range(3)),
        *(("\\design.shared.inner", f"\\inner{k}") for k in range(2)),
    ]
    verilog = to_verilog(Delays(3), name="design")
    assert verilog.count("\nmodule ") == 3


def test_single_component_is_not_shared():
    assert "shared.delay" not in to_rtlil(Delays(1), name="design")


def test_no_sharing_outside_a_conversion():
    """In Amaranth's simulator an instance would have no module."""
    delays = [Delay(), Delay()]
    assert shared_instances(delays, "delay") == delays
    to_rtlil(Delays(2))
    assert shared_instances(delays, "delay") == delays


@pytest.mark.parametrize("convert", [to_verilog, to_rtlil])
def test_a_shared_register_with_a_reset_is_refused(convert):
    """A soft reset would not reach it."""
    with pytest.raises(ValueError, match=r"shared module top\.shared\.delay resets a register"):
        convert(Delays(2, resets=True))
    assert convert(Delays(1, resets=True)).count("rst") > convert(Delays(1)).count("rst")


def test_shared_module_names_are_unique():
    with pytest.raises(ValueError, match="shared module delay: expected a name that is not taken yet"):
        to_rtlil(Delays(2, name="delay"))
