"""The core as a packaged IP: `component.xml` (IP-XACT, IEEE 1685-2009) as Vivado's catalog reads it.

Bus interfaces follow from the names of the ports: `s_axil_...` is the AXI4-Lite slave of the registers,
every `..._tvalid` an AXI4-Stream, and `clk`, `rst` and `interrupt` are what they say. Names of Vivado's own
parameters are those of UG1118 (Creating and Packaging Custom IP).
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence

from fastac.gateware.target.verilog_module import Port

SPIRIT = "http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009"
XILINX = "http://www.xilinx.com"
VENDOR, LIBRARY, VERSION = "fastac", "user", "1.0"
FAMILIES = (
    *("zynq", "zynquplus", "artix7", "kintex7", "virtex7", "kintexu", "virtexu"),
    *("artixuplus", "kintexuplus", "virtexuplus"),
)
"""Vivado's names of the families for which the catalog offers the IP: the Verilog names no device."""
AXI_LITE, CLOCK, RESET, INTERRUPT = "s_axil", "clk", "rst", "interrupt"
SEGMENT = "Reg"
"""Name of the registers' address block; in a block design the segment is `INSTANCE/s_axil/Reg`."""
ACCESS = {"ro": "read-only", "rw": "read-write", "w1c": "read-write", "wo": "write-only"}
"""Words of IP-XACT for a register's access, which CMSIS-SVD has too."""
FILE_SETS = {
    "synthesis": "xilinx_anylanguagesynthesis",
    "simulation": "xilinx_anylanguagebehavioralsimulation",
}
GUI_SET = "xilinx_xpgui"


def vlnv(name: str) -> str:
    """Vendor, library, name and version of the IP, as `create_bd_cell -vlnv` takes them."""
    return f"{VENDOR}:{LIBRARY}:{name}:{VERSION}"


def component(
    name: str,
    ports: Sequence[Port],
    registers: Sequence[Mapping],
    *,
    address_range: int,
    verilog: str,
    gui: str,
    description: str,
) -> str:
    """The text of `component.xml` for the Verilog module `name`.

    registers : as in hardware.json: name, offset, access, meaning, and, where known, fields
    address_range : bytes of the address block
    verilog, gui : paths of the Verilog and of the GUI's script, from the folder of component.xml
    """
    ET.register_namespace("spirit", SPIRIT)
    ET.register_namespace("xilinx", XILINX)
    root = ET.Element(_tag("component"))
    for tag, text in (("vendor", VENDOR), ("library", LIBRARY), ("name", name), ("version", VERSION)):
        _add(root, tag, text)
    interfaces = _add(root, "busInterfaces")
    buses = []
    for prefix, of_bus in _grouped(ports).items():
        kind = _axi_lite if prefix == AXI_LITE else _axi_stream
        kind(interfaces, prefix, of_bus)
        buses.append(prefix)
    clock = {"ASSOCIATED_BUSIF": ":".join(buses), "ASSOCIATED_RESET": RESET}
    # No FREQ_HZ: the frequency then comes from what drives the clock, as for the DMAs' streams. One that was
    # stated here would differ from it by a few Hz, and Vivado refuse the design: "FREQ_HZ does not match".
    clock["FREQ_TOLERANCE_HZ"] = "-1"
    _signal(interfaces, CLOCK, "clock", "CLK", "slave", clock)
    _signal(interfaces, RESET, "reset", "RST", "slave", {"POLARITY": "ACTIVE_HIGH"})
    _signal(interfaces, INTERRUPT, "interrupt", "INTERRUPT", "master", {"SENSITIVITY": "LEVEL_HIGH"})
    _memory_map(root, registers, address_range)
    _model(root, name, ports)
    _file_sets(root, verilog, gui)
    _add(root, "description", description)
    parameters = _add(root, "parameters")
    _parameter(parameters, "Component_Name", f"{name}_v1_0", "PARAM_VALUE.Component_Name", resolve="user")
    _core_extensions(root, name)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _tag(name: str, namespace: str = SPIRIT) -> str:
    return f"{{{namespace}}}{name}"


def _add(parent: ET.Element, name: str, text: object = None, /, **attributes: object) -> ET.Element:
    found = ET.SubElement(parent, _tag(name), {_tag(key): str(value) for key, value in attributes.items()})
    found.text = None if text is None else str(text)
    return found


def _parameter(parent: ET.Element, name: str, value: object, identifier: str, **attributes: str) -> None:
    parameter = _add(parent, "parameter")
    _add(parameter, "name", name)
    _add(parameter, "value", value, id=identifier, **attributes)


def _grouped(ports: Sequence[Port]) -> dict[str, list[Port]]:
    """The ports of each bus by its prefix, in the order in which the buses begin."""
    prefixes = [port.name.removesuffix("_tvalid") for port in ports if port.name.endswith("_tvalid")]
    found: dict[str, list[Port]] = {}
    for port in ports:
        for prefix in (AXI_LITE, *prefixes):
            if port.name.startswith(f"{prefix}_"):
                found.setdefault(prefix, []).append(port)
    return found


def _interface(
    parent: ET.Element,
    name: str,
    kind: tuple[str, str],
    mode: str,
    ports: Mapping[str, str],
    parameters: Mapping[str, object],
    memory_map: str | None = None,
) -> None:
    """A bus interface; kind: library and name of the bus; ports: the physical port of each logical one."""
    interface = _add(parent, "busInterface")
    _add(interface, "name", name)
    library, bus = kind
    for tag, of_kind in (("busType", bus), ("abstractionType", f"{bus}_rtl")):
        _add(interface, tag, vendor="xilinx.com", library=library, name=of_kind, version="1.0")
    side = _add(interface, mode)
    if memory_map is not None:
        _add(side, "memoryMapRef", memoryMapRef=memory_map)
    maps = _add(interface, "portMaps")
    for logical, physical in ports.items():
        port_map = _add(maps, "portMap")
        for tag, text in (("logicalPort", logical), ("physicalPort", physical)):
            _add(_add(port_map, tag), "name", text)
    if parameters:
        of_interface = _add(interface, "parameters")
        for key, value in parameters.items():
            _parameter(of_interface, key, value, f"BUSIFPARAM_VALUE.{name.upper()}.{key}")


def _signal(parent, name: str, bus: str, logical: str, mode: str, parameters: Mapping[str, object]) -> None:
    _interface(parent, name, ("signal", bus), mode, {logical: name}, parameters)


def _logical(prefix: str, ports: Sequence[Port]) -> dict[str, str]:
    return {port.name.removeprefix(f"{prefix}_").upper(): port.name for port in ports}


def _axi_lite(parent: ET.Element, prefix: str, ports: Sequence[Port]) -> None:
    width = {port.name: port.width for port in ports}
    parameters = {
        "PROTOCOL": "AXI4LITE",
        "DATA_WIDTH": width[f"{prefix}_wdata"],
        "ADDR_WIDTH": width[f"{prefix}_awaddr"],
        "HAS_BURST": 0,
        "SUPPORTS_NARROW_BURST": 0,
        "NUM_READ_OUTSTANDING": 1,
        "NUM_WRITE_OUTSTANDING": 1,
    }
    _interface(parent, prefix, ("interface", "aximm"), "slave", _logical(prefix, ports), parameters, prefix)


def _axi_stream(parent: ET.Element, prefix: str, ports: Sequence[Port]) -> None:
    width = {port.name.removeprefix(f"{prefix}_"): port.width for port in ports}
    valid = next(port for port in ports if port.name == f"{prefix}_tvalid")
    parameters = {
        "TDATA_NUM_BYTES": width["tdata"] // 8,
        "TDEST_WIDTH": 0,
        "TID_WIDTH": 0,
        "TUSER_WIDTH": width.get("tuser", 0),
        "HAS_TREADY": int("tready" in width),
        "HAS_TSTRB": 0,
        "HAS_TKEEP": int("tkeep" in width),
        "HAS_TLAST": int("tlast" in width),
    }
    mode = "slave" if valid.direction == "in" else "master"
    _interface(parent, prefix, ("interface", "axis"), mode, _logical(prefix, ports), parameters)


def _memory_map(root: ET.Element, registers: Sequence[Mapping], address_range: int) -> None:
    found = _add(_add(root, "memoryMaps"), "memoryMap")
    _add(found, "name", AXI_LITE)
    block = _add(found, "addressBlock")
    _add(block, "name", SEGMENT)
    _add(block, "baseAddress", 0, format="long")
    _add(block, "range", address_range, format="long")
    _add(block, "width", 32, format="long")
    _add(block, "usage", "register")
    for register in registers:
        element = _add(block, "register")
        _add(element, "name", register["name"])
        _add(element, "description", register["meaning"])
        _add(element, "addressOffset", f"{register['offset']:#x}")
        _add(element, "size", 32)
        _add(element, "access", ACCESS[register["access"]])
        if register.get("reset") is not None:
            _add(_add(element, "reset"), "value", f"{register['reset']:#x}")
        for field in register.get("fields") or ():
            of_register = _add(element, "field")
            _add(of_register, "name", field["name"])
            _add(of_register, "bitOffset", field["low"])
            _add(of_register, "bitWidth", field["width"])
            _add(of_register, "access", ACCESS[register["access"]])
            if register["access"] == "w1c":
                _add(of_register, "modifiedWriteValue", "oneToClear")


def _model(root: ET.Element, name: str, ports: Sequence[Port]) -> None:
    model = _add(root, "model")
    views = _add(model, "views")
    for kind, view in FILE_SETS.items():
        element = _view(views, view, f":vivado.xilinx.com:{kind}")
        _add(element, "language", "Verilog")
        _add(element, "modelName", name)
        _file_set_reference(element, view)
    _file_set_reference(_view(views, GUI_SET, ":vivado.xilinx.com:xgui.ui"), GUI_SET)
    of_model = _add(model, "ports")
    for port in ports:
        element = _add(of_model, "port")
        _add(element, "name", port.name)
        wire = _add(element, "wire")
        _add(wire, "direction", port.direction)
        if port.width > 1:
            vector = _add(wire, "vector")
            _add(vector, "left", port.width - 1, format="long")
            _add(vector, "right", 0, format="long")
        definition = _add(_add(wire, "wireTypeDefs"), "wireTypeDef")
        _add(definition, "typeName", "wire")
        for view in FILE_SETS.values():
            _add(definition, "viewNameRef", view)


def _view(parent: ET.Element, name: str, environment: str) -> ET.Element:
    view = _add(parent, "view")
    _add(view, "name", name)
    _add(view, "envIdentifier", environment)
    return view


def _file_set_reference(view: ET.Element, name: str) -> None:
    _add(_add(view, "fileSetRef"), "localName", f"{name}_view_fileset")


def _file_sets(root: ET.Element, verilog: str, gui: str) -> None:
    sets = _add(root, "fileSets")
    for name, path, kinds in _files(verilog, gui):
        file_set = _add(sets, "fileSet")
        _add(file_set, "name", f"{name}_view_fileset")
        file = _add(file_set, "file")
        _add(file, "name", path)
        for tag, kind in kinds:
            _add(file, tag, kind)


def _files(verilog: str, gui: str) -> Iterator[tuple[str, str, tuple[tuple[str, str], ...]]]:
    for name in FILE_SETS.values():
        yield name, verilog, (("fileType", "verilogSource"),)
    yield GUI_SET, gui, (("fileType", "tclSource"), ("userFileType", "XGUI_VERSION_2"))


def _core_extensions(root: ET.Element, name: str) -> None:
    extensions = ET.SubElement(_add(root, "vendorExtensions"), _tag("coreExtensions", XILINX))

    def add(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
        found = ET.SubElement(parent, _tag(tag, XILINX), {_tag(k, XILINX): v for k, v in attributes.items()})
        found.text = text
        return found

    families = add(extensions, "supportedFamilies")
    for family in FAMILIES:
        add(families, "family", family, lifeCycle="Production")
    add(add(extensions, "taxonomies"), "taxonomy", "/UserIP")
    add(extensions, "displayName", name)
    add(extensions, "coreRevision", "1")
