"""The C example, compiled by gcc with the generated header, against the simulation and the UIO stand-in."""

import subprocess
from pathlib import Path

import pytest
from board_stand_in import UioBoard
from described_hardware import content

from fastac.driver.transports.simulation import Simulator
from fastac.gateware.target.register_files.write import register_files

EXAMPLE = Path(__file__).parents[3] / "examples" / "c"
FLAGS = ("-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror")


@pytest.fixture(scope="module")
def header(bundle, tmp_path_factory) -> Path:
    """The folder of the generated header."""
    folder = tmp_path_factory.mktemp("header")
    name = "fastac_registers.h"
    (folder / name).write_text(register_files(content(bundle))[name])
    return folder


@pytest.fixture
def program(header, tmp_path):
    """`program(board, **defines)`: the example for that board."""

    def compiled(board: str, **defines: str) -> Path:
        path = tmp_path / board
        sources = [EXAMPLE / "newtons.c", EXAMPLE / f"{board}.c"]
        macros = [f'-D{name}="{value}"' for name, value in defines.items()]
        command = ["gcc", *FLAGS, f"-I{header}", f"-I{EXAMPLE}", *macros, *map(str, sources), "-o", str(path)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return path

    return compiled


@pytest.fixture
def frame_file(frames, tmp_path) -> Path:
    """A frame in memory: three channels, padded to four bytes."""
    path = tmp_path / "frame"
    padded = b"".join(pixel.tobytes() + b"\0" for pixel in frames[3].reshape(-1, 3))
    path.write_bytes(padded)
    return path


def run(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run([str(a) for a in arguments], capture_output=True, text=True, timeout=60)


def assert_forces(printed: str, expected) -> None:
    first, *forces = printed.splitlines()
    assert first.startswith("frame 1, ")
    found = [line.split() for line in forces]
    assert [axis for axis, _, _ in found] == ["x", "y", "z"]
    assert [float(force) for _, force, _ in found] == pytest.approx(expected, rel=1e-8)


@pytest.mark.full
def test_simulation(program, frame_file, verilog, simulator_folder, expected):
    with Simulator(verilog, simulator_folder) as simulator:
        done = run(program("board_socket"), simulator.socket, frame_file)
    assert done.returncode == 0, done.stderr
    assert_forces(done.stdout, expected.force_n[3])


def test_uio(program, frame_file, bundle, description, expected, tmp_path):
    board = UioBoard(bundle, description, tmp_path / "board", dma="axi_dma_0")
    try:
        done = run(program("board_uio", SYS=board.sys, DEV=board.dev), "udmabuf0", frame_file)
        assert done.returncode == 0, done.stderr
        assert_forces(done.stdout, expected.force_n[3])
        board.board.model.values["VERSION"] = 99
        done = run(program("board_uio", SYS=board.sys, DEV=board.dev), "udmabuf0", frame_file)
        wrong = f"newtons: VERSION = 0x00000063: expected 0x{description.version:08x}\n"
        assert (done.returncode, done.stderr) == (1, wrong)
    finally:
        board.close()


def test_no_board(program, frame_file, tmp_path):
    done = run(program("board_socket"), tmp_path / "none", frame_file)
    assert (done.returncode, done.stderr) == (1, f"{tmp_path / 'none'}: No such file or directory\n")
    done = run(program("board_uio", SYS=tmp_path, DEV=tmp_path), "udmabuf0", frame_file)
    assert (done.returncode, done.stderr) == (1, f"board: {tmp_path}/uio: no device fastac_0\n")
    frame_file.write_bytes(b"short")
    done = run(program("board_socket"), tmp_path / "none", frame_file)
    assert (done.returncode, done.stderr) == (1, f"newtons: {frame_file}: expected a file of 1024 bytes\n")
