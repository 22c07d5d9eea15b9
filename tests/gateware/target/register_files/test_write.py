# amaranth: UnusedElaboratable=no
"""Each file of the register map is read by a tool of others, and holds what the register map says."""

import shutil
import subprocess

import numpy as np
import pytest
from cmsis_svd.parser import SVDParser
from lxml import etree
from systemrdl import RDLCompiler
from systemrdl.node import RegNode

from fastac.gateware.bus.record import PLAIN, RecordFlag
from fastac.gateware.bus.register_map import REGISTERS
from fastac.gateware.host_interface import host_interface
from fastac.gateware.target.block_design import BlockDesignError
from fastac.gateware.target.register_files.write import FILES, register_files, write_register_files
from fastac.gateware.top_zynq import TopZynq
from fastac.models.random_bundle import random_bundle, scene

KNOWN = {register.name: register for register in REGISTERS}
ZYNQ_MPSOC, ZYNQ_7000 = "xczu19eg-ffvc1760-2-i", "xc7z020clg400-1"
needs_dtc = pytest.mark.skipif(
    shutil.which("dtc") is None, reason="dtc is not installed: apt-get install device-tree-compiler"
)


def described(folder, outputs, part, *, streams="packets", **changes) -> dict:
    """What hardware.json says of random integers, less what comes from elaborating them."""
    top = TopZynq(random_bundle(folder / "bundle", scene(outputs, streams=streams, **changes)))
    facts = {"top": "fastac", "part": part, "bundle_sha256": top.bundle.digest}
    return facts | host_interface(top)


@pytest.fixture(scope="module")
def packets(tmp_path_factory) -> dict:
    """Three images, three axes of force, packets, loadable weights, on a Zynq MPSoC."""
    folder = tmp_path_factory.mktemp("packets")
    outputs = ("normals", "depth", "force_map", "force_xyz")
    return described(folder, outputs, ZYNQ_MPSOC, lanes=2)


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> dict:
    """One force, video, baked weights, on a Zynq-7000."""
    folder = tmp_path_factory.mktemp("video")
    return described(folder, ("force_z",), ZYNQ_7000, streams="video", solver="adjoint", weights="baked")


@pytest.fixture(params=["packets", "video"])
def hardware(request) -> dict:
    return request.getfixturevalue(request.param)


@pytest.fixture
def folder(hardware, tmp_path):
    write_register_files(hardware, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == set(FILES.values())
    return tmp_path


def expected_macros(hardware) -> dict[str, int]:
    """Offsets, masks, shifts and reset values, from the register map."""
    found = {}
    for register in hardware["registers"]:
        name = register["name"]
        found[f"{name}_OFFSET"] = KNOWN[name].offset
        if register["reset"] is not None:
            found[f"{name}_RESET"] = register["reset"]
        for field in KNOWN[name].fields:
            found[f"{name}_{field.name.upper()}_SHIFT"] = field.low
            found[f"{name}_{field.name.upper()}_MASK"] = ((1 << field.width) - 1) << field.low
    return found


def compiled(folder, source: str, compiler: str, *arguments: str):
    """The program of a source that includes the header, compiled with warnings as errors."""
    file, program = folder / f"program.{'c' if compiler == 'gcc' else 'cc'}", folder / "program"
    file.write_text(source)
    strict = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion")
    subprocess.run([compiler, *arguments, *strict, "-o", program, file], check=True, cwd=folder)
    return program


@pytest.mark.parametrize(("compiler", "standard"), [("gcc", "-std=c11"), ("g++", "-std=c++11")])
def test_c_header(hardware, folder, compiler, standard):
    """A program prints all macros; the header compiles without a warning, twice included."""
    text = (folder / "fastac_registers.h").read_text()
    names = [line.split()[1] for line in text.splitlines() if line.startswith("#define FASTAC_")]
    scales = [name for name in names if name.endswith("_PER_LSB")]
    numbers = [n for n in names if n not in (*scales, "FASTAC_REGISTERS_H", "FASTAC_ASSERT(condition)")]
    lines = [f'printf("{n} %u\\n", {n});' for n in numbers]
    lines += [f'printf("{n} %.17g\\n", {n});' for n in scales]
    source = '#include "fastac_registers.h"\n#include "fastac_registers.h"\n#include <stdio.h>\n'
    program = compiled(
        folder, f"{source}int main(void) {{\n{chr(10).join(lines)}\nreturn 0;\n}}\n", compiler, standard
    )
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()
    found = dict(zip(printed[::2], printed[1::2], strict=True))
    for name, value in expected_macros(hardware).items():
        assert int(found.pop(f"FASTAC_{name}")) == value, name
    assert not [name for name in found if name.endswith(("_OFFSET", "_SHIFT", "_RESET"))]
    assert int(found["FASTAC_HARDWARE_VERSION"]) == hardware["version"]
    frame, force = hardware["frame"], hardware["force"]
    assert int(found["FASTAC_FRAME_WIDTH_PX"]) == frame["width_px"]
    for axis, scale in force["newtons_per_lsb"].items():
        assert float(found[f"FASTAC_FORCE_{axis.upper()}_N_PER_LSB"]) == scale
    for output in hardware["outputs"]:
        name = output["name"].upper()
        assert int(found[f"FASTAC_{name}_PACKET_BYTES"]) == output["packet_bytes"]
        assert int(found[f"FASTAC_{name}_COMPLETE"]) == output["complete"]
    for flag in RecordFlag if "results" in hardware else ():
        assert int(found[f"FASTAC_RECORD_{flag.name}_MASK"]) == flag
    if hardware["outputs"]:
        assert float(found["FASTAC_DEPTH_MM_PER_LSB"]) == hardware["outputs"][1]["per_lsb"]


def test_record_in_c(packets, tmp_path):
    """A program reads a record's bytes, and prints what NumPy reads."""
    write_register_files(packets, tmp_path)
    names = PLAIN.layout.names
    prints = "\n".join(f'printf("%lld\\n", (long long)record.{name});' for name in names)
    program = compiled(
        tmp_path,
        '#include "fastac_registers.h"\n#include <stdio.h>\nint main(void) {\nstruct fastac_record record;\n'
        f"if (fread(&record, sizeof record, 1, stdin) != 1) return 1;\n{prints}\nreturn 0;\n}}\n",
        "gcc",
        "-std=c11",
    )
    octets = np.random.default_rng(1).bytes(PLAIN.layout.itemsize)
    (record,) = np.frombuffer(octets, PLAIN.layout)
    printed = subprocess.run([program], input=octets, check=True, capture_output=True).stdout.split()
    assert [int(x) for x in printed] == [int(np.int64(record[name].astype(np.int64))) for name in names]


def test_svd(hardware, folder):
    """Valid by the schema of CMSIS, and read by a parser of others."""
    assert SVDParser.validate_xml_file(str(folder / "fastac.svd"))
    device = SVDParser.for_xml_file(str(folder / "fastac.svd")).get_device()
    (peripheral,) = device.peripherals
    assert peripheral.base_address == (0xA000_0000 if hardware["streams"] == "packets" else 0x43C0_0000)
    assert [interrupt.value for interrupt in peripheral.interrupts] == [
        89 if hardware["streams"] == "packets" else 29
    ]
    registers = {register.name: register for register in peripheral.get_registers()}
    assert list(registers) == [register["name"] for register in hardware["registers"]]
    kinds = {"ro": "read-only", "rw": "read-write", "w1c": "read-write", "wo": "write-only"}
    for entry in hardware["registers"]:
        found, known = registers[entry["name"]], KNOWN[entry["name"]]
        assert (found.address_offset, found.access.value) == (known.offset, kinds[known.access]), known.name
        fields = [(field.name.lower(), field.bit_offset, field.bit_width) for field in found.get_fields()]
        assert fields == [tuple(field) for field in known.fields], known.name
        assert found.description.lower().startswith(known.meaning[:40].lower())
        if entry["reset"] is not None:
            assert found.reset_value == entry["reset"]
        assert (found.modified_write_values is not None) == (known.access == "w1c"), known.name
        assert (found.read_action is not None) == known.read_changes, known.name


def test_system_rdl(hardware, folder):
    compiler = RDLCompiler()
    compiler.compile_file(str(folder / "fastac.rdl"))
    top = compiler.elaborate().top
    registers = {node.inst_name: node for node in top.children() if isinstance(node, RegNode)}
    assert list(registers) == [register["name"] for register in hardware["registers"]]
    for entry in hardware["registers"]:
        node, known = registers[entry["name"]], KNOWN[entry["name"]]
        assert (node.address_offset, node.size) == (known.offset, 4)
        fields = {field.inst_name: field for field in node.fields()}
        whole = {"value": (0, 32)}
        places = {field.name: (field.low, field.width) for field in known.fields} or whole
        assert {name: (field.lsb, field.width) for name, field in fields.items()} == places, known.name
        for name, field in fields.items():
            readable, writable = known.access != "wo", known.access != "ro"
            assert (field.is_sw_readable, field.is_sw_writable) == (readable, writable), known.name
            clears = field.get_property("onwrite")
            assert (clears is not None and clears.name == "woclr") == (known.access == "w1c")
            assert (field.get_property("onread") is not None) == known.read_changes
            if entry["reset"] is not None:
                low, width = places[name]
                assert field.get_property("reset") == entry["reset"] >> low & (1 << width) - 1


def test_page(hardware, folder):
    lines = (folder / "registers.md").read_text().splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if line.startswith("| `0x")
    ]
    assert [row[1].strip("`") for row in rows] == [register["name"] for register in hardware["registers"]]
    for (offset, name, access, reset, meaning), entry in zip(rows, hardware["registers"], strict=True):
        assert (int(offset.strip("`"), 16), access) == (entry["offset"], entry["access"]), name
        assert reset == "–" if entry["reset"] is None else int(reset.strip("`"), 16) == entry["reset"]
        assert meaning.lower() == f"{entry['meaning'].lower()}."
    assert ("## The record of a result" in lines) == ("results" in hardware)
    assert "## Fields" in lines


BASES = {
    "packets": """/dts-v1/;
/ { #address-cells = <2>; #size-cells = <2>;
    gic: gic { #interrupt-cells = <3>; #address-cells = <0>; interrupt-controller; };
    zynqmp_clk: clocks { #clock-cells = <1>; };
    zynqmp_reset: resets { #reset-cells = <1>; };
    fpga_full: fpga-full { }; amba: axi { #address-cells = <2>; #size-cells = <2>; }; };
""",
    "video": """/dts-v1/;
/ { #address-cells = <1>; #size-cells = <1>;
    intc: intc { #interrupt-cells = <3>; #address-cells = <0>; interrupt-controller; };
    clkc: clocks { #clock-cells = <1>; };
    fpga_full: fpga-full { }; amba: axi { #address-cells = <1>; #size-cells = <1>; }; };
""",
}
"""What the overlay's labels stand for on a board, by the streams."""


def tree_with_overlay(hardware, folder) -> str:
    """The file of a board's device tree with the overlay applied: both compiled without a warning."""
    base, overlay, whole = folder / "base.dtb", folder / "overlay.dtbo", folder / "whole.dtb"
    (folder / "base.dts").write_text(BASES[hardware["streams"]])
    for source, output in ((folder / "base.dts", base), (folder / "fastac.dtso", overlay)):
        done = subprocess.run(
            ["dtc", "-@", "-I", "dts", "-O", "dtb", "-o", output, source], capture_output=True, text=True
        )
        assert (done.returncode, done.stderr) == (0, "")
    subprocess.run(["fdtoverlay", "-i", base, "-o", whole, overlay], check=True)
    return str(whole)


def cells(tree: str, node: str, key: str) -> list[int]:
    printed = subprocess.run(
        ["fdtget", "-t", "x", tree, node, key], check=True, capture_output=True, text=True
    )
    return [int(cell, 16) for cell in printed.stdout.split()]


def text(tree: str, node: str, key: str) -> list[str]:
    printed = subprocess.run(
        ["fdtget", "-t", "s", tree, node, key], check=True, capture_output=True, text=True
    )
    return printed.stdout.split()


@needs_dtc
def test_device_tree_of_packets(packets, tmp_path):
    write_register_files(packets, tmp_path)
    tree = tree_with_overlay(packets, tmp_path)
    core = "/axi/fastac@a0000000"
    assert cells(tree, core, "reg") == [0, 0xA000_0000, 0, 0x1_0000]
    assert cells(tree, core, "interrupts") == [0, 89, 4]
    assert text(tree, core, "compatible") == [f"fastac,fingertip-{packets['version']}", "generic-uio"]
    assert text(tree, core, "linux,uio-name") == ["fastac_0"]
    assert cells(tree, core, "interrupt-parent") == cells(tree, "/gic", "phandle")
    assert cells(tree, "/fpga-full/clocking0", "clocks") == [*cells(tree, "/clocks", "phandle"), 71]
    assert cells(tree, "/fpga-full/clocking0", "assigned-clock-rates") == [150_000_000]
    assert cells(tree, "/fpga-full", "resets") == [*cells(tree, "/resets", "phandle"), 116]
    interrupts = {0: [0, 90, 4, 0, 91, 4], 1: [0, 92, 4], 2: [0, 93, 4]}
    for k, lines in interrupts.items():
        dma = f"/axi/dma@a00{k + 1}0000"
        assert cells(tree, dma, "reg") == [0, 0xA001_0000 + k * 0x1_0000, 0, 0x1_0000]
        assert cells(tree, dma, "interrupts") == lines
        assert text(tree, dma, "linux,uio-name") == [f"axi_dma_{k}"]
    (size,) = cells(tree, "/axi/udmabuf0", "size")
    sizes = [packets["frame"]["bytes"], *(output["packet_bytes"] for output in packets["outputs"])]
    assert size & (size - 1) == 0
    assert 16 * sum(sizes) <= size < 32 * sum(sizes)


@needs_dtc
def test_device_tree_of_video(video, tmp_path):
    """The core alone: nothing is known of what is around it."""
    write_register_files(video, tmp_path)
    tree = tree_with_overlay(video, tmp_path)
    core = "/axi/fastac@43c00000"
    assert cells(tree, core, "reg") == [0x43C0_0000, 0x1_0000]
    assert cells(tree, core, "interrupts") == [0, 29, 4]
    assert cells(tree, "/fpga-full/clocking0", "clocks") == [*cells(tree, "/clocks", "phandle"), 15]
    nodes = subprocess.run(["fdtget", "-l", tree, "/axi"], check=True, capture_output=True, text=True)
    assert nodes.stdout.split() == ["fastac@43c00000"]


def test_markup_in_texts_is_escaped(packets):
    changed = packets | {"registers": [packets["registers"][0] | {"meaning": 'a < b & "c" | d'}]}
    files = register_files(changed)
    descriptions = [node.text for node in etree.fromstring(files["fastac.svd"].encode()).iter("description")]
    assert descriptions[-1] == 'A < b & "c" | d.'
    assert 'A < b & "c" \\| d.' in files["registers.md"]
    assert "A < b & 'c' | d." in files["fastac.rdl"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"part": "xc7a100t"}, "part 'xc7a100t': expected one of xczu19eg"),
        ({"clock_mhz": None}, "clock_mhz"),
    ],
)
def test_what_cannot_be_written(packets, changed, message, tmp_path):
    hardware = {key: value for key, value in (packets | changed).items() if value is not None}
    with pytest.raises((BlockDesignError, KeyError), match=message):
        write_register_files(hardware, tmp_path)
    assert not list(tmp_path.iterdir())
