# amaranth: UnusedElaboratable=no
"""A design in its parts."""

from amaranth import Module, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.synth_netlist import UNIT, parts, ports
from gateware.elaboration import alike, to_rtlil


def test_equal_modules_are_one_part(design, modules):
    assert [part.instances for part in design] == [["left", "right"], ["delay"], ["top (own logic)"]]
    assert [(p.name, p.width, p.is_input) for p in ports(modules["delay"].text)] == [
        ("\\clk", 1, True),
        ("\\i", 1, True),
        ("\\rst", 1, True),
        ("\\o", 1, False),
    ]
    assert all(UNIT in part.text and "fastac" not in part.text for part in design)


def test_elements_of_arrays_do_not_look_like_bits():
    """nextpnr takes a signal `o[1]` for bit 1 of `o`."""
    shape = data.ArrayLayout(signed(4), 2)
    component = wiring.Component({"i": In(shape), "o": Out(shape)})
    module = Module()
    module.d.sync += [component.o[1].eq(component.i[0]), component.o[0].eq(component.i[1])]
    component.elaborate = lambda platform: module
    text = to_rtlil(component, name="fastac")
    assert "\\o[1]" in text
    [part] = parts(text, "fastac")
    assert "\\o[1]" not in part.text
    assert "\\o.1" in part.text
    assert "\\o [7:4]" in part.text


class Inverter(wiring.Component):
    """Its input inverted, a clock later."""

    i: In(1)
    o: Out(1)

    def elaborate(self, platform):
        m = Module()
        held = Signal(reset_less=True)
        m.d.sync += held.eq(~self.i)
        m.d.comb += self.o.eq(held)
        return m


class Inverters(wiring.Component):
    """Two of them, alike, one behind the other."""

    i: In(1)
    o: Out(1)

    def elaborate(self, platform):
        m = Module()
        first, second = both = Inverter(), Inverter()
        m.submodules.first, m.submodules.second = alike(both, "inverter")
        m.d.comb += [first.i.eq(self.i), second.i.eq(first.o), self.o.eq(second.o)]
        return m


def test_instances_of_a_shared_module_are_one_part():
    text = to_rtlil(Inverters(), name="fastac")
    assert text.count("\nmodule ") == 2
    [part] = parts(text, "fastac")
    assert part.instances == ["first", "second"]
    assert {port.name for port in ports(part.text)} == {"\\clk", "\\i", "\\rst", "\\o"}
    assert "fastac" not in part.text
