"""The folder of `fastac vivado`: names that cannot clash, and what other tools make of it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from packet_hardware import BUNDLE_SHA256, output, packet_hardware, verilog

from fastac.gateware.bus.registers import Identity, RegisterBlock
from fastac.gateware.target.boards import BOARDS, BoardError, choose_board
from fastac.gateware.target.elaboration import LINT_WAIVERS, to_verilog
from fastac.gateware.target.tcl_words import variable, word
from fastac.gateware.target.vivado_folder import write_vivado_folder
from fastac.scenes.parts import PARTS
from fastac.sim.runner import EXECUTABLE, use_verilator

NAME = "fastac_01234567"
PORTS = packet_hardware(output("depth", 14, 14, 1, 2), lanes=2)


def written(folder: Path, **changes) -> Path:
    hardware = PORTS | changes
    folder.mkdir()
    write_vivado_folder(verilog(hardware), hardware, folder, board="none")
    return folder


def test_what_a_user_gets(tmp_path):
    folder = written(tmp_path / "vivado")
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files >= {
        *("build.tcl", "block_design.tcl", "checks.tcl", "settings.tcl", "README.txt", "hardware.json"),
        "fastac.v",
        *(f"ip/{NAME}/component.xml", f"ip/{NAME}/src/{NAME}.v", "core/build.tcl", "fastac.core"),
    }
    readme = (folder / "README.txt").read_text()
    assert "0xa0010000  axi_dma_0" in readme
    assert "1  90  axi_dma_0/mm2s_introut" in readme
    assert (folder / "fastac.v").read_text() == verilog(PORTS)
    # No clock is created for the IP inside a block design.
    assert not list((folder / "ip").rglob("*.xdc"))


def test_video_has_an_ip_and_no_block_design(tmp_path):
    folder = written(tmp_path / "vivado", streams="video")
    assert (folder / f"ip/{NAME}/component.xml").exists()
    assert not (folder / "build.tcl").exists()
    assert "there is no block design" in (folder / "README.txt").read_text()


def test_two_bundles_in_one_design(tmp_path):
    """Verilator finds no module twice where both are instantiated; with equal names it would."""
    identity = Identity(1, 7, height=16, width=16, channels=3, lanes=1, axes="z", depth=False)
    text = to_verilog(RegisterBlock(identity), name="fastac")
    sources = []
    for digest in (BUNDLE_SHA256, BUNDLE_SHA256[::-1]):
        folder = tmp_path / digest[:4]
        folder.mkdir()
        hardware = PORTS | {"streams": "video", "bundle_sha256": digest}
        write_vivado_folder(text, hardware, folder, board="none")
        sources += folder.glob("ip/*/src/*.v")
    instances = "".join(f"  {path.stem} u{k} (.clk(clk));\n" for k, path in enumerate(sources))
    (tmp_path / "both.v").write_text(f"module both(input clk);\n{instances}endmodule\n")
    use_verilator()
    command = [EXECUTABLE, "--lint-only", "-Wall", "-Wno-PINMISSING", LINT_WAIVERS, tmp_path / "both.v"]
    subprocess.run([*command, *sources, "--top-module", "both"], check=True)
    again = tmp_path / "again.v"
    again.write_text(sources[0].read_text())
    done = subprocess.run(
        [*command, *sources, again, "--top-module", "both"], capture_output=True, check=False
    )
    assert b"MODDUP" in done.stderr


@pytest.fixture
def fusesoc(tmp_path):
    """Run FuseSoC on the folder, with nothing of the user's; returns what it printed."""

    def run(folder: Path, *arguments: str) -> str:
        use_verilator()
        home = {
            name: str(tmp_path) for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME")
        }
        entry = "import sys; from fusesoc.main import main; sys.exit(main())"
        done = subprocess.run(
            [sys.executable, "-c", entry, "--cores-root", folder, *arguments],
            cwd=tmp_path,
            env=os.environ | home,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    return run


@pytest.mark.full
def test_fusesoc_lints_the_core(tmp_path, fusesoc):
    folder = tmp_path / "vivado"
    folder.mkdir()
    identity = Identity(1, 7, height=16, width=16, channels=3, lanes=1, axes="z", depth=False)
    text = to_verilog(RegisterBlock(identity), name="fastac")
    write_vivado_folder(text, PORTS | {"streams": "video"}, folder, board="none")
    assert NAME in fusesoc(folder, "core", "list")
    printed = fusesoc(folder, "run", "--target=lint", f"fastac:sensor:{NAME}")
    assert "verilator" in printed
    assert "Warning" not in printed


def test_edalize_makes_a_project_for_vivado(tmp_path, fusesoc):
    folder = written(tmp_path / "vivado")
    fusesoc(folder, "run", "--setup", "--target=synth", "--build-root=work", f"fastac:sensor:{NAME}")
    (project,) = (tmp_path / "work").rglob(f"*{NAME}_1.0.0.tcl")
    lines = project.read_text().splitlines()
    assert f"set_property part {PORTS['part']} [current_project]" in lines
    assert f"set_property top {NAME} [current_fileset]" in lines
    read = {
        line.split()[0]: project.parent / line.split()[1].strip("{}") for line in lines if "core/" in line
    }
    assert set(read) == {"read_verilog", "read_xdc", "source"}
    assert all(path.exists() for path in read.values())
    assert "-mode out_of_context" in read["source"].read_text()


def test_board_of_a_part():
    assert choose_board("xck26-sfvc784-2LV-c", None) == "kv260"
    assert choose_board("xck26-sfvc784-2LV-c", "kr260") == "kr260"
    assert choose_board("xczu19eg-ffvc1760-2-i", None) == "none"
    assert choose_board("xc7z020clg400-1", "none") == "none"
    with pytest.raises(BoardError, match="board zcu104: has xczu7ev-ffvc1156-2-e; hardware"):
        choose_board("xck26-sfvc784-2LV-c", "zcu104")
    with pytest.raises(BoardError, match=f"board 'moon': expected none or one of {', '.join(BOARDS)}"):
        choose_board("xck26-sfvc784-2LV-c", "moon")


def test_boards_that_scenes_may_mean_have_files():
    """Of each part in the scenes' table the boards that it names are known here, too."""
    named = {board: part for part in PARTS for board in PARTS[part].boards}
    assert {board: BOARDS[board].part for board in named} == named


def test_words_of_tcl():
    assert word(None) == "{}"
    assert word("a b") == "{a b}"
    assert word({"a": None, "b": ["c d", 1]}) == "{a {} b {{c d} 1}}"
    assert variable("x", [1, "a b"]) == "set x {\n    1\n    {a b}\n}\n"
    assert variable("x", 7) == "set x 7\n"
    with pytest.raises(ValueError, match="expected no braces"):
        word("}")
