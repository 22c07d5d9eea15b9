"""Device tree overlay of the block design, for a running Linux: bitstream, clock, UIO devices, DMA buffer.

The kernel's FPGA region loads the bitstream (`firmware-name`) when the overlay is applied. The core and each
DMA become UIO devices by the driver uio_pdrv_genirq (`compatible = "generic-uio"`), named as in the block
design, and u-dma-buf makes the buffer `udmabuf0`. Labels and bindings are those of AMD's kernel, Linux 5.15
or later: `fpga_full`, `amba`, `zynqmp_clk` or `clkc`, `gic` or `intc`; `xlnx,fclk`; `xlnx,afi-fpga`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from fastac.gateware.target.block_design import CORE, RANGE, ZYNQ_7000, BlockDesign

OVERLAY, BITSTREAM, BUFFER = "fastac.dtso", "fastac.bit.bin", "udmabuf0"
FRAMES_IN_BUFFER = 16
"""Frames, with all their packets, that the buffer has room for: twice what can be in flight."""
LEAST_BUFFER = 1 << 20
SHARED_PERIPHERAL, LEVEL_HIGH = 0, 4
"""Cells of an interrupt: its kind, and its sensitivity (binding arm,gic)."""
SHELL = '{\n    "shell_type": "XRT_FLAT",\n    "num_slots": "1"\n}\n'
"""shell.json, by which the Kria's xmutil knows an application that is the whole programmable logic."""


@dataclass(frozen=True)
class _Kernel:
    """Labels in the base device tree; cells: of an address, and of a size, on the bus `amba`."""

    interrupts: str
    clock: str
    cells: int


_KERNELS = {"zynquplus": _Kernel("gic", "zynqmp_clk 71", 2), "zynq7000": _Kernel("intc", "clkc 15", 1)}
"""Clock 71 of zynqmp_clk is PL0_REF, 15 of clkc is fclk0."""
_AFI = """
    afi0 {
        compatible = "xlnx,afi-fpga";
        config-afi = <0 0>, <1 0>, <2 0>, <3 0>, <4 0>, <5 0>, <6 0>, <7 0>, <8 0>, <9 0>, <10 0>,
            <11 0>, <12 0>, <13 0>, <14 0xa00>, <15 0>;
    };
"""
"""Widths of the ports between processing system and logic, of the Zynq MPSoC: 128 bits, as after reset."""


def buffer_bytes(hardware: Mapping) -> int:
    """Size of the DMA buffer, a power of two, by hardware.json."""
    packets = [output["packet_bytes"] for output in hardware["outputs"]]
    each = hardware["frame"]["bytes"] + sum(packets) + hardware["results"]["record_bytes"]
    return max(LEAST_BUFFER, 1 << (FRAMES_IN_BUFFER * each - 1).bit_length())


def overlay(design: BlockDesign, buffer_size: int) -> str:
    """The source text of the overlay; compile it with `dtc -@ -I dts -O dtb`."""
    kernel = _KERNELS[design.family.name]
    cells = f"#address-cells = <{kernel.cells}>;\n    #size-cells = <{kernel.cells}>;"
    lines = {each.instance: each for each in reversed(design.interrupts)}
    devices = "".join(
        _device(instance, address, lines[instance].spi, kernel)
        for instance, address in design.addresses.items()
    )
    return f"""\
/* Overlay of the block design around {CORE}; written by `fastac vivado`. */
/dts-v1/;
/plugin/;

&fpga_full {{
    {cells}
    firmware-name = "{BITSTREAM}";
}};

&amba {{
    {cells}
{"" if design.family is ZYNQ_7000 else _AFI}
    fastac_clock: clocking0 {{
        compatible = "xlnx,fclk";
        #clock-cells = <0>;
        clocks = <&{kernel.clock}>;
        assigned-clocks = <&{kernel.clock}>;
        assigned-clock-rates = <{round(design.clock_mhz * 1e6)}>;
    }};
{devices}
    {BUFFER} {{
        compatible = "ikwzm,u-dma-buf";
        device-name = "{BUFFER}";
        size = <{buffer_size:#x}>;
    }};
}};
"""


def _device(instance: str, address: int, spi: int, kernel: _Kernel) -> str:
    """A UIO device; of a DMA's interrupts its first, for UIO takes one."""
    high = "0x0 " * (kernel.cells - 1)
    return f"""
    {instance}: {instance}@{address:x} {{
        compatible = "generic-uio";
        linux,uio-name = "{instance}";
        reg = <{high}{address:#x} {high}{RANGE:#x}>;
        interrupt-parent = <&{kernel.interrupts}>;
        interrupts = <{SHARED_PERIPHERAL} {spi} {LEVEL_HIGH}>;
    }};
"""
