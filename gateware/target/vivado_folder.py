"""The folder that a user runs in Vivado: packaged IP, block design, constraints, core file.

    ip/NAME/            the packaged IP: component.xml, Verilog, GUI
    build.tcl           from there to bitstream and .xsa, with block_design.tcl, checks.tcl and settings.tcl
    core/               the core alone, out of context: build.tcl, Verilog, constraints, waivers of its lint
    fastac.core         the core alone for FuseSoC and Edalize
    registers/          the register map for other tools, and fastac.dtso, the overlay for the board's Linux
    shell.json          by which the Kria's xmutil knows an application
    fastac.v            the Verilog as it was before its modules were renamed, for simulations
    hardware.json       what a driver needs to know
    fastac.saif         the simulated activity, if there is one, for the power estimate

NAME is `fastac_` and the first eight digits of the bundle's hash, which the register BUNDLE_HASH_HIGH shows.
So designs of several bundles can stand in one block design: no two modules have the same name.
"""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

from fastac.gateware.target import ip_xact
from fastac.gateware.target.block_design import CORE, RANGE, BlockDesign, block_design
from fastac.gateware.target.elaboration import LINT_WAIVERS
from fastac.gateware.target.fusesoc_core import CORE_FILE, OUT_OF_CONTEXT, core_file
from fastac.gateware.target.verilog_module import ports_of, renamed
from fastac.gateware.target.vivado import write_vivado_project
from fastac.gateware.target.vivado_scripts import write_scripts

SAIF = "fastac.saif"
GUI = 'proc init_gui {IPINST} {\n    ipgui::add_param $IPINST -name "Component_Name"\n}\n'
"""The IP has no parameter but its name."""
SHELL = '{\n    "shell_type": "XRT_FLAT",\n    "num_slots": "1"\n}\n'
"""shell.json of an application that is the whole programmable logic."""


def module_name(hardware: Mapping) -> str:
    """The name of the IP and of its top module, by hardware.json."""
    return f"{hardware['top']}_{hardware['bundle_sha256'][:8]}"


def write_vivado_folder(
    verilog: str, hardware: Mapping, folder: Path, *, board: str, saif: Path | None = None
) -> None:
    """Write all files into `folder`, which exists.

    verilog, hardware : texts of the build's Verilog and content of its hardware.json
    board : of gateware/target/boards.py, or "none"
    saif : file of the core's activity

    With streams = "video" there is no block design: no stock DMA takes these streams.
    """
    name = module_name(hardware)
    text = renamed(verilog, hardware["top"], name)
    description = f"FasTac core for scene {hardware['scene']}"
    _write_ip(text, hardware, folder / "ip" / name, name=name, description=description)
    core = folder / "core"
    core.mkdir()
    write_vivado_project(text, core, hardware["clock_mhz"], part=hardware["part"], name=name)
    (core / "out_of_context.tcl").write_text(OUT_OF_CONTEXT, encoding="utf-8")
    shutil.copyfile(LINT_WAIVERS, core / "lint.vlt")
    (folder / CORE_FILE).write_text(
        core_file(
            name,
            verilog=f"core/{name}.v",
            constraints=f"core/{name}.xdc",
            script="core/out_of_context.tcl",
            waivers="core/lint.vlt",
            part=hardware["part"],
            description=description,
        ),
        encoding="utf-8",
    )
    (folder / f"{hardware['top']}.v").write_text(verilog, encoding="utf-8")
    (folder / "hardware.json").write_text(json.dumps(hardware, indent=2) + "\n", encoding="utf-8")
    if saif is not None:
        for place in (folder, core):
            shutil.copyfile(saif, place / SAIF)
    design = None
    if hardware["streams"] == "packets":
        design = block_design(hardware)
        write_scripts(design, folder, name=name, board=board)
        (folder / "shell.json").write_text(SHELL, encoding="utf-8")
    (folder / "README.txt").write_text(_readme(name, hardware, design, board), encoding="utf-8")


def _write_ip(text: str, hardware: Mapping, folder: Path, *, name: str, description: str) -> None:
    """The packaged IP."""
    for place in ("src", "xgui"):
        (folder / place).mkdir(parents=True)
    (folder / f"src/{name}.v").write_text(text, encoding="utf-8")
    (folder / f"xgui/{name}_v1_0.tcl").write_text(GUI, encoding="utf-8")
    content = ip_xact.component(
        name,
        ports_of(text, name),
        hardware["registers"],
        address_range=RANGE,
        verilog=f"src/{name}.v",
        gui=f"xgui/{name}_v1_0.tcl",
        description=description,
    )
    (folder / "component.xml").write_text(content, encoding="utf-8")


def _readme(name: str, hardware: Mapping, design: BlockDesign | None, board: str) -> str:
    """What to run, and, of a block design, addresses and interrupts."""
    lines = [
        f"FasTac, scene {hardware['scene']}: {name}, {hardware['part']}, {hardware['clock_mhz']:g} MHz",
        "",
        f"ip/ is a repository of IPs for Vivado's settings (IP, Repository); {ip_xact.vlnv(name)} is in it.",
        "core/build.tcl synthesises and routes the core alone, out of context:",
        "    cd core && vivado -mode batch -source build.tcl",
    ]
    if design is None:
        lines += [
            "",
            "The streams are those of video: there is no block design. `fastac vivado --streams packets`.",
        ]
        return "\n".join(lines) + "\n"
    lines += [
        "build.tcl makes block design and bitstream, into output/ (Vivado 2020.2 or later):",
        "    vivado -mode batch -source build.tcl",
        f"Board files: {board}; another: -tclargs --board NAME (none: of no board).",
        "Settings of your own for the processing system: processing_system.tcl beside build.tcl.",
        "-tclargs --to design, synthesis or implementation stops there.",
        "",
        "registers/ has the registers for other tools, and fastac.dtso, the overlay for the board's Linux.",
        "The way from here to a running board: docs/board.md of FasTac.",
        "",
        "Addresses:",
        *(f"    {address:#010x}  {instance}" for instance, address in design.addresses.items()),
        "",
        f"Interrupts, level high (line of the concat, number as the device tree counts); {CORE} is the core:",
        *(f"    {each.line}  {each.spi}  {each.instance}/{each.pin}" for each in design.interrupts),
    ]
    return "\n".join(lines) + "\n"
