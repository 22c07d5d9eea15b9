# amaranth: UnusedElaboratable=no
import pytest
from amaranth import Value

from fastac.gateware.bus.registers import Identity, RegisterBlock
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.target.verilog_module import Port, ports_of, renamed


def component():
    return RegisterBlock(Identity(1, 7, height=16, width=16, channels=3, lanes=1, axes="z", depth=False))


@pytest.fixture(scope="module")
def text():
    return to_verilog(component(), name="fastac")


def test_ports(text):
    made = component()
    wanted = {"clk": ("in", 1), "rst": ("in", 1)}
    for path, member, value in made.signature.flatten(made):
        wanted["__".join(map(str, path))] = (member.flow.name.lower(), len(Value.cast(value)))
    assert {port.name: (port.direction, port.width) for port in ports_of(text, "fastac")} == wanted


def test_ports_of_a_module_that_is_not_there(text):
    with pytest.raises(ValueError, match="module 'fast': expected one of this name"):
        ports_of(text, "fast")


def test_renamed_with_all_below(text):
    assert "\\fastac.slave" in text
    found = renamed(text, "fastac", "fastac_12ab")
    assert "fastac." not in found
    assert "module fastac(" not in found
    assert ports_of(found, "fastac_12ab") == ports_of(text, "fastac")
    assert renamed(found, "fastac_12ab", "fastac") == text


def test_a_vector_of_one_bit_is_a_port():
    assert ports_of("module m(a);\n  input [0:0] a;\nendmodule\n", "m") == [Port("a", "in", 1)]
