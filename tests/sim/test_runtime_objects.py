"""The cache of Verilator's runtime: compiled once for all simulators with the same flags, and complete."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from fastac.sim import runner, runtime_objects, simulators
from fastac.sim.runtime_objects import RuntimeObjects

VERILOG = "module follower(input clk, input a, output reg b); always @(posedge clk) b <= a; endmodule\n"


@pytest.fixture
def build(tmp_path, monkeypatch):
    source = tmp_path / "follower.v"
    source.write_text(VERILOG)

    def build(name: str, *more: str):
        """Build the follower's simulator in a new folder, with an empty cache of simulators."""
        monkeypatch.setattr(simulators, "CACHE", tmp_path / "simulators" / name)
        folder = tmp_path / name
        folder.mkdir()
        runner.build(source, "follower", folder, build_args=(*runner.QUICK, *more))
        assert (folder / "follower").is_file()
        return folder

    return build


@pytest.mark.full
def test_the_second_simulator_takes_the_runtime_of_the_first(build, tmp_path, monkeypatch):
    monkeypatch.setattr(runtime_objects, "CACHE", tmp_path / "kept")
    first = build("first")
    [kept] = (path for path in (tmp_path / "kept").iterdir() if path.is_dir())
    assert {"verilated.o", "verilated_vpi.o", "runtime.h.gch"} <= {path.name for path in kept.iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in kept.iterdir()}
    second = build("second")
    assert {path.name: path.stat().st_mtime_ns for path in kept.iterdir()} == times
    for folder in (first, second):
        assert (folder / "verilated.o").read_bytes() == (kept / "verilated.o").read_bytes()
        assert (folder / "runtime.h.gch").samefile(kept / "runtime.h.gch")
        assert "verilated.cpp" not in (folder / "build.log").read_text()

    # Other flags, another runtime; one that cannot be compiled is not kept at all.
    assert RuntimeObjects(first, "-O0").cached == kept
    assert not RuntimeObjects(first, "-O1").cached.exists()
    makefile = first / "Vtop.mk"
    makefile.write_text(makefile.read_text() + "\nOPT_GLOBAL = -no-such-option\n")
    other = RuntimeObjects(first, "-O0")
    with pytest.raises(subprocess.CalledProcessError):
        other.install()
    assert [path for path in (tmp_path / "kept").iterdir() if path.is_dir()] == [kept]


def test_sources_are_compiled_behind_precompiled_headers(build):
    """The compiler says where it cannot use them."""
    folder = build("first")
    [command] = (c for name, c in runtime_objects.commands(folder, "-O0").items() if name.endswith(".gch"))
    flags = command[: command.index("-x")]
    use = ["-Winvalid-pch", "-Werror", "-H", "-include", runtime_objects.HEADER, "-c", "Vtop__ALL.cpp"]
    made = subprocess.run([*flags, *use, "-o", "/dev/null"], cwd=folder, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert "! ./runtime.h.gch" in made.stderr


def test_no_command_python_is_needed(build, tmp_path, monkeypatch):
    """Debian's python3 alone brings no `python`."""
    commands = tmp_path / "commands"
    commands.mkdir()
    for folder in os.environ["PATH"].split(os.pathsep):
        for command in Path(folder).glob("*"):
            if not command.name.startswith("python") and not (commands / command.name).exists():
                (commands / command.name).symlink_to(command)
    monkeypatch.setenv("PATH", str(commands))
    assert shutil.which("python") is None
    build("first")


@pytest.mark.full
def test_a_design_of_several_sources_has_its_own_precompiled_header(build):
    """As the tops of scenes have; the compiler uses one precompiled header only."""
    folder = build("first", "--output-split", "1")
    assert "VM_PARALLEL_BUILDS = 1" in (folder / "Vtop_classes.mk").read_text()
    assert runtime_objects.compiled_with(folder, "-O1") == "OPT_FAST=-O1"
