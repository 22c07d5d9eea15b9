"""The register map in forms that other tools read, from hardware.json: C, SVD, SystemRDL, device tree, text.

Nothing here has been used on a board. Tests have each file read by a tool of others: gcc, a parser of SVD
files with their schema, a compiler of SystemRDL, and dtc.
"""

from collections.abc import Mapping
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from fastac.gateware.bus.record import FORMS, PLAIN
from fastac.gateware.packet_format import power_of_two
from fastac.gateware.target.block_design import (
    CORE,
    RANGE,
    ZYNQ_7000,
    ZYNQ_ULTRASCALE_PLUS,
    Family,
    block_design,
    family_of,
)
from fastac.gateware.target.ip_xact import ACCESS
from fastac.gateware.target.register_files.register_view import (
    MAP_BYTES,
    c_number,
    constants,
    record_fields,
    record_flags,
    register_views,
)
from fastac.store.files import write_atomically

FILES = {
    "registers.h": "fastac_registers.h",
    "registers.svd": "fastac.svd",
    "registers.rdl": "fastac.rdl",
    "registers.md": "registers.md",
    "overlay.dtso": "fastac.dtso",
}
"""Name of the file that each template makes."""
RDL_ACCESS = {
    "ro": "sw = r; hw = w;",
    "rw": "sw = rw; hw = r;",
    "w1c": "sw = rw; hw = w; onwrite = woclr;",
    "wo": "sw = w; hw = r;",
}
DEVICE_TREES = {
    ZYNQ_ULTRASCALE_PLUS.name: {
        "cells": 2,
        "controller": "gic",
        "clock": ("zynqmp_clk", 71),
        "resets": "<&zynqmp_reset 116>",
    },
    ZYNQ_7000.name: {"cells": 1, "controller": "intc", "clock": ("clkc", 15), "resets": None},
}
"""Of each family: cells of an address, the interrupt controller's label in the kernel's device trees, and the
clock controller's with the clock's number there: PL0_REF (dt-bindings/clock/xlnx-zynqmp-clk.h) and fclk0
(bindings/clock/zynq-7000.txt). resets: on Zynq MPSoC pl_resetn0 is a GPIO, which a boot loader that knows of
no logic may have left low; 116 is PS_PL0 (dt-bindings/reset/xlnx-zynqmp-resets.h), and AMD's page "Solution
ZynqMP PL Programming" has it at this place. On Zynq-7000 the FPGA manager's driver releases the resets."""
FRAMES_BUFFERED = 16
"""Frames, each with its packets, that the buffer in the device tree holds at least."""


def register_files(hardware: Mapping) -> dict[str, str]:
    """The texts of all files by their names, from what hardware.json says.

    Raises KeyError for a key that it lacks, BlockDesignError for a part without a known processing system or
    packets that no DMA takes.
    """
    environment = Environment(
        loader=PackageLoader("fastac.gateware.target.register_files", "."),
        undefined=StrictUndefined,
        autoescape=lambda name: name is not None and name.startswith("registers.svd"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"c_number": c_number, "cell": _cell}
    family = family_of(hardware["part"])
    results = hardware.get("results")
    facts = {
        "scene": hardware["scene"],
        "version": hardware["version"],
        "digest": hardware["bundle_sha256"],
        "registers": register_views(hardware),
        "constants": constants(hardware),
        "results": results,
        "record": record_fields(FORMS[results["format"]] if results else PLAIN),
        "flags": record_flags(),
        "base": family.core_address,
        "map_bytes": MAP_BYTES,
        "interrupt": family.first_spi,
        "interrupt_kind": hardware["interrupt"],
        "svd_access": ACCESS,
        "rdl_access": RDL_ACCESS,
        **_device_tree(hardware, family),
    }
    return {
        file: environment.get_template(f"{template}.j2").render(facts) for template, file in FILES.items()
    }


def write_register_files(hardware: Mapping, folder: Path) -> None:
    """Write all files to `folder`, each whole or not at all; raises what `register_files` raises."""
    for name, text in register_files(hardware).items():
        with write_atomically(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _device_tree(hardware: Mapping, family: Family) -> dict:
    """What the overlay says beside the registers; with video streams what is around the core is not known."""
    slaves = [
        {
            "instance": CORE,
            "node": "fastac",
            "compatible": f"fastac,fingertip-{hardware['version']}",
            "address": family.core_address,
            "spis": [family.first_spi],
        }
    ]
    buffer_bytes = 0
    if hardware["streams"] == "packets":
        design = block_design(hardware)
        slaves += [
            {
                "instance": dma.instance,
                "node": "dma",
                "compatible": "fastac,axi-dma",
                "address": dma.address,
                "spis": [found.spi for found in design.interrupts if found.instance == dma.instance],
            }
            for dma in design.dmas
        ]
        packets = sum(channel.packet_bytes for dma in design.dmas for channel in dma.channels)
        buffer_bytes = power_of_two(FRAMES_BUFFERED * packets)
    tree = DEVICE_TREES[family.name]
    label, index = tree["clock"]
    return {
        "part": hardware["part"],
        "firmware": f"{hardware['top']}.bit.bin",
        "cells": tree["cells"],
        "controller": tree["controller"],
        "resets": tree["resets"],
        "clock": {"label": label, "index": index, "hz": round(hardware["clock_mhz"] * 1e6)},
        "slaves": slaves,
        "range": RANGE,
        "buffer_bytes": buffer_bytes,
    }


def _cell(value: int, cells: int) -> str:
    """A number as that many 32-bit cells of a device tree."""
    return " ".join(f"{value >> 32 * k & 0xFFFFFFFF:#x}" for k in reversed(range(cells)))
