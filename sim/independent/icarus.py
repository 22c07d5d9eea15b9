"""Icarus Verilog: four states, so that an unknown is seen wherever it reaches an output."""

import re
import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fastac.sim.independent import bench
from fastac.sim.independent.outcome import Outcome, SimulatorError, parsed
from fastac.sim.independent.process import run
from fastac.sim.independent.stimulus import Stimulus

COMPILER, SIMULATOR = "iverilog", "vvp"
DIALECT = "-g2005"
"""As SystemVerilog the initialisers of Yosys' `always @*` triggers make no event: constants stay unknown."""


def installed() -> bool:
    return shutil.which(COMPILER) is not None and shutil.which(SIMULATOR) is not None


def version() -> str:
    """Such as "11.0 (stable)"."""
    done = subprocess.run([COMPILER, "-V"], capture_output=True, text=True, check=False)
    return re.search(r"version (\S+( \(\w+\))?)", done.stdout)[1]


def simulate(
    sources: Sequence[Path], top: str, stimulus: Stimulus, folder: Path, *, progress: bool = False
) -> Outcome:
    """The Verilog `sources` with top module `top`, under the bench and the files in `folder`.

    Raises SimulatorError if Icarus is missing, refuses the design, or the bench does not come to its end.
    """
    if not installed():
        raise SimulatorError(f"{COMPILER} is not installed: install the system's package iverilog")
    (folder / "bench.v").write_text(bench.text("bench.v.j2", stimulus, top))
    started = time.monotonic()
    paths = [str(path.resolve()) for path in sources]
    compile_command = [COMPILER, DIALECT, "-s", "bench", "-o", "bench.vvp", "bench.v", *paths]
    run(compile_command, folder, "compile.log", label="compiling for Icarus Verilog", progress=progress)
    built = time.monotonic()
    command = [SIMULATOR, "-N", "bench.vvp"]
    label = f"Icarus Verilog, {stimulus.frames} frames"
    output = run(command, folder, "icarus.log", label=label, total=stimulus.limit, progress=progress)
    found = parsed(output, stimulus, four_states=True)
    return replace(found, build_s=built - started, run_s=time.monotonic() - built)
