"""Our models of block RAM and DSP cells, which Yosys' own library has without behaviour."""

from pathlib import Path

from fastac.sim.independent.bench import rendered

DSP, BLOCK_RAMS = Path(__file__).with_name("our_dsp48e2.v"), "our_block_rams.v.j2"
FILES = (DSP.name, BLOCK_RAMS.removesuffix(".j2"))
RAMS = (
    {"name": "RAMB36E2", "rows": 128, "word": 36, "lanes": 4, "address": 15},
    {"name": "RAMB18E2", "rows": 64, "word": 18, "lanes": 2, "address": 14},
)
"""rows: attributes INIT_xx of 256 bits; word, lanes: bits with parity and bytes of a port's widest word."""


def write(folder: Path) -> list[Path]:
    """Write the models, `FILES`, to `folder`; returns their paths."""
    dsp, block_rams = (folder / name for name in FILES)
    dsp.write_text(DSP.read_text())
    block_rams.write_text(rendered(BLOCK_RAMS, rams=RAMS))
    return [dsp, block_rams]
