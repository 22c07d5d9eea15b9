"""A simulated board in a process of its own: the Verilog, DMAs and memory behind a Unix-domain socket.

    python -m fastac.sim.board build/paper/verilog/fastac.v build/paper/verilog/hardware.json SOCKET FOLDER

Whoever connects to SOCKET first (within a minute) drives the hardware by sim/board/protocol.py; the process
ends when that connection does. FOLDER holds the simulator and its logs.
"""

import json
import sys
from pathlib import Path

from fastac.sim.runner import QUICK, build

BENCH = "fastac.sim.board.bench"
LOG = "simulation.log"
SMALL_PX = 1 << 12
"""Frames with fewer pixels are simulated faster than an optimised simulator is built."""


def serve(source: Path, hardware: Path, socket: Path, folder: Path) -> None:
    """Build the simulator of the Verilog `source` and serve one connection."""
    description = json.loads(hardware.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    frame = description["frame"]
    quick = frame["height_px"] * frame["width_px"] < SMALL_PX
    name = description["top"]
    runner = build(source, name, folder / "build", build_args=QUICK if quick else ())
    settings = {"FASTAC_HARDWARE": str(hardware.resolve()), "FASTAC_SOCKET": str(socket)}
    runner.test(
        hdl_toplevel=name,
        test_module=BENCH,
        build_dir=folder / "build",
        extra_env=settings,
        log_file=folder / LOG,
    )


def main(arguments: list[str]) -> None:
    if len(arguments) != 4:
        raise SystemExit("usage: python -m fastac.sim.board VERILOG HARDWARE_JSON SOCKET FOLDER")
    serve(*map(Path, arguments))


if __name__ == "__main__":
    main(sys.argv[1:])
