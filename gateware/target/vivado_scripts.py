"""The scripts that make a block design around the packaged core and build its bitstream.

The Tcl itself lies in `gateware/target/tcl/` and is the same for every design; what differs is data, which
`settings` writes. That `build.tcl` was run in Vivado is nowhere claimed: tests run it in a Tcl interpreter in
which Vivado's commands are recorded and held against the manual (tests/gateware/target/test_vivado_tcl.py).
"""

import shutil
from pathlib import Path

from fastac.gateware.target import ip_xact
from fastac.gateware.target.block_design import CORE, RANGE, BlockDesign, Dma
from fastac.gateware.target.boards import boards_with
from fastac.gateware.target.tcl_words import array, variable

TCL = Path(__file__).with_name("tcl")
SCRIPTS = ("build.tcl", "block_design.tcl", "checks.tcl")
SETTINGS = "settings.tcl"


def settings(design: BlockDesign, *, name: str, board: str) -> str:
    """The text of settings.tcl; name: the IP's and its Verilog's; board: of gateware/target/boards.py."""
    values = {
        "part": design.part,
        "family": design.family.name,
        "board": board,
        "clock_mhz": f"{design.clock_mhz:g}",
        "vlnv": ip_xact.vlnv(name),
        "instance": CORE,
        "segment": ip_xact.SEGMENT,
        "core_address": f"{design.core_address:#010x}",
        "range": f"{RANGE:#x}",
        "dma_address_bits": design.family.address_bits,
        "memory_port_bits": design.family.memory_port_bits,
    }
    patterns = {key: each.pattern for key, each in boards_with(design.part).items()}
    interrupts = [f"{interrupt.instance}/{interrupt.pin}" for interrupt in design.interrupts]
    return "".join(
        (
            "# What the scripts beside this file need to know of the hardware; written by `fastac vivado`.\n",
            array("settings", values),
            variable("boards", patterns),
            variable("dmas", [_dma(dma) for dma in design.dmas]),
            variable("interrupts", interrupts),
        )
    )


def _dma(dma: Dma) -> dict[str, object]:
    """A DMA's entry of `dmas`; its words are empty for a channel that it lacks."""
    sent, received = dma.mm2s, dma.s2mm
    return {
        "instance": dma.instance,
        "address": f"{dma.address:#010x}",
        "length_bits": dma.length_bits,
        "mm2s": sent and sent.port,
        "mm2s_bits": sent and sent.stream_bits,
        "mm2s_memory_bits": sent and sent.memory_bits,
        "s2mm": received.port,
        "s2mm_memory_bits": received.memory_bits,
    }


def write_scripts(design: BlockDesign, folder: Path, *, name: str, board: str) -> None:
    """Write the scripts and their settings into `folder`."""
    for script in SCRIPTS:
        shutil.copyfile(TCL / script, folder / script)
    (folder / SETTINGS).write_text(settings(design, name=name, board=board), encoding="utf-8")
