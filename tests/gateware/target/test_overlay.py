"""The overlay's source, compiled by the device tree compiler and read back from its binary."""

import re
import shutil
import subprocess

import pytest
from packet_hardware import output, packet_hardware

from fastac.gateware.target.block_design import block_design
from fastac.gateware.target.overlay import buffer_bytes, overlay

needs_dtc = pytest.mark.skipif(
    shutil.which("dtc") is None, reason="no device tree compiler: Debian's device-tree-compiler"
)
MPSOC = packet_hardware(output("normals", 128, 128, 4, 4), output("depth", 126, 126, 1, 4), lanes=4)
ZYNQ = packet_hardware(part="xc7z020clg400-1", side=16, clock_mhz=100.0)


def compiled(hardware: dict, tmp_path) -> str:
    """The overlay after a way through its binary, without whitespace between words."""
    source, binary = tmp_path / "fastac.dtso", tmp_path / "fastac.dtbo"
    source.write_text(overlay(block_design(hardware), buffer_bytes(hardware)))
    done = subprocess.run(
        ["dtc", "-@", "-I", "dts", "-O", "dtb", "-o", binary, source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    text = subprocess.run(
        ["dtc", "-I", "dtb", "-O", "dts", binary], capture_output=True, text=True, check=True
    ).stdout
    return " ".join(text.split())


@needs_dtc
@pytest.mark.parametrize("hardware", [MPSOC, ZYNQ], ids=["zynquplus", "zynq7000"])
def test_devices_at_their_addresses_with_their_interrupts(hardware, tmp_path):
    design, text = block_design(hardware), compiled(hardware, tmp_path)
    cell = r"(0x[0-9a-f]+)"
    high = "0x00 " if hardware is MPSOC else ""
    for instance, address in design.addresses.items():
        node = re.search(rf"{instance}@{address:x} {{(.*?)}};", text)[1]
        assert 'compatible = "generic-uio"' in node
        assert f'linux,uio-name = "{instance}"' in node
        found = re.search(rf"reg = <{high}{cell} {high}{cell}>", node)
        assert [int(word, 16) for word in found.groups()] == [address, 0x1_0000]
        kind, spi, sense = re.search(rf"interrupts = <{cell} {cell} {cell}>", node).groups()
        first = next(each for each in design.interrupts if each.instance == instance)
        assert [int(kind, 16), int(spi, 16), int(sense, 16)] == [0, first.spi, 4]
    assert f"assigned-clock-rates = <{round(design.clock_mhz * 1e6):#x}>" in text
    assert 'firmware-name = "fastac.bit.bin"' in text
    # The labels of the kernel's tree are resolved when the overlay is applied.
    labels = re.search(r"__fixups__ {(.*?)};", text)[1]
    wanted = ("gic", "zynqmp_clk") if hardware is MPSOC else ("intc", "clkc")
    assert all(f"{label} =" in labels for label in ("fpga_full", "amba", *wanted))


@needs_dtc
def test_buffer(tmp_path):
    node = re.search(r"udmabuf0 {(.*?)};", compiled(MPSOC, tmp_path))[1]
    size = int(re.search(r"size = <(0x[0-9a-f]+)>", node)[1], 16)
    assert size == buffer_bytes(MPSOC)
    assert 'device-name = "udmabuf0"' in node


def test_the_buffer_holds_sixteen_frames_with_their_packets():
    packets = sum(each["packet_bytes"] for each in MPSOC["outputs"])
    needed = 16 * (MPSOC["frame"]["bytes"] + packets + 64)
    size = buffer_bytes(MPSOC)
    assert needed <= size < 2 * needed
    assert size & (size - 1) == 0
    assert buffer_bytes(ZYNQ) == 1 << 20
