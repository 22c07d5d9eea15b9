"""Verilator's runtime is compiled once for all simulators of the same flags, and never half kept."""

import pytest

from fastac.sim import runner, runtime_objects

VERILOG = "module follower(input clk, input a, output reg b); always @(posedge clk) b <= a; endmodule\n"


@pytest.fixture
def build(tmp_path, monkeypatch):
    monkeypatch.setattr(runtime_objects, "CACHE", tmp_path / "kept")
    source = tmp_path / "follower.v"
    source.write_text(VERILOG)

    def build(name: str) -> str:
        """What the build in a new folder printed."""
        folder = tmp_path / name
        folder.mkdir()
        runner.build(source, "follower", folder)
        assert (folder / "follower").is_file()
        return (folder / "build.log").read_text()

    return build


def test_the_second_simulator_takes_the_runtime_of_the_first(build, tmp_path):
    assert "verilated.cpp" in build("first")
    assert "verilated.cpp" not in build("second")
    [kept] = (tmp_path / "kept").iterdir()
    assert "verilated.o" in {path.name for path in kept.iterdir()}
    assert (kept / "verilated.o").read_bytes() == (tmp_path / "second/verilated.o").read_bytes()
    before = runtime_objects.RuntimeObjects(tmp_path / "first")
    makefile = tmp_path / "first/Vtop.mk"
    makefile.write_text(makefile.read_text() + "\nOPT_GLOBAL = -O0\n")
    other = runtime_objects.RuntimeObjects(tmp_path / "first")
    assert before.kept.is_dir()
    assert not other.kept.exists()
    other.take()
    assert other.names == before.names
    (tmp_path / "first/verilated.o").unlink()
    with pytest.raises(FileNotFoundError):
        other.keep()
    assert [path.name for path in (tmp_path / "kept").iterdir()] == [before.kept.name]
