"""A design in its parts."""

from amaranth import Module, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.target.elaboration import to_rtlil
from fastac.synth.netlist import UNIT, parts, ports


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


def test_instances_of_a_shared_module_are_one_part(text_of_shared):
    # The assembly, the products' module and the delay.
    assert text_of_shared.count("\nmodule ") == 3
    found = parts(text_of_shared, "fastac")
    # Instances come behind the submodules that are elaborated in place.
    assert [part.instances for part in found] == [["delay"], ["left", "right"], ["top (own logic)"]]
    names = ("a", "b", "c", "clk", "o", "rst")
    assert {port.name for port in ports(found[1].text)} == {f"\\{name}" for name in names}
    assert all("fastac" not in part.text for part in found)
