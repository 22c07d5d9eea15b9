"""`fastac run`: frames of every kind of source, through emulator and simulation, to terminal and files."""

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import av
import h5py
import numpy as np
import pytest
from command_line import fail, run, succeed
from described_hardware import frames_of, write_hardware
from PIL import Image

from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.random_bundle import random_bundle, scene
from fastac.sensor import dataset


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """A build folder of a sensor of 16 × 16 px, whose streams are video, with data and Verilog."""
    folder = tmp_path_factory.mktemp("built") / "video"
    model = random_bundle(folder / "bundle", scene(("depth", "force_z"), mode="difference", lanes=2))
    frames = frames_of(model, 8)
    dataset.write(
        folder / "data.h5",
        pitch_mm=model.scene.sensor.pitch_mm,
        channels=model.scene.sensor.channel_names,
        source="noise",
        background=model.pipeline.background,
        split=np.array(["train"] * 2 + ["test"] * 6),
        frames=frames,
        force_n=np.zeros((8, 3)),
    )
    write_hardware(model, folder / "verilog")
    return folder


@pytest.fixture(scope="module")
def colours(tmp_path_factory) -> Path:
    """A build folder of the same sensor with frames in packets; slopes alone give the force."""
    folder = tmp_path_factory.mktemp("built") / "colours"
    wanted = scene(("force_xyz",), solver="adjoint", lanes=4, streams="packets")
    write_hardware(random_bundle(folder / "bundle", wanted), folder / "verilog")
    return folder


def table(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def forces(path: Path) -> list[list[float]]:
    """Every axis of the CSV file, frame by frame."""
    rows = table(path)
    axes = [name for name in rows[0] if name.startswith("force_")]
    return [[float(row[axis]) for axis in axes] for row in rows]


def test_dataset_through_emulator_and_simulation(built, tmp_path):
    """The default source is the build's data; the frames' images go to HDF5."""
    model = bundles.load(built / "bundle")
    expected = Emulator(model.pipeline).run(frames_of(model, 8)[2:])
    rows = {}
    for via in ("emulator", "sim"):
        files = tmp_path / f"{via}.csv", tmp_path / f"{via}.h5"
        arguments = ("--split", "test", "--csv", files[0], "--hdf5", files[1], "--no-progress")
        printed = succeed("run", built, "--via", via, *arguments).stdout.splitlines()
        suspect = int((expected.validity != 0).sum())
        assert re.fullmatch(rf"6 frames in .* s: 0 lost, 0 bad, {suspect} suspect", printed[0])
        assert printed[-2:] == [str(file) for file in files]
        rows[via] = table(files[0])
        np.testing.assert_allclose(forces(files[0]), expected.force_n, rtol=1e-8)
        with h5py.File(files[1]) as file:
            np.testing.assert_allclose(file["force_z_n"], expected.force_n[:, 0])
            np.testing.assert_allclose(file["depth_mm"], expected.depth_mm[:, 1:-1, 1:-1], atol=1e-6)
            assert file["depth_mm"].attrs["unit"] == "mm"
            np.testing.assert_array_equal(file["validity"], expected.validity)
            assert file.attrs["bundle_sha256"] == model.digest
    kept = ("frame", "force_z_n", "bad", "suspect", "lost", "reasons", "first_pixel_to_result_s")
    for emulated, simulated in zip(rows["emulator"], rows["sim"], strict=True):
        assert [emulated[name] for name in kept] == [simulated[name] for name in kept]
    assert [int(row["frame"]) for row in rows["sim"]] == list(range(1, 7))


def test_video_folder_and_batches(colours, tmp_path):
    model = bundles.load(colours / "bundle")
    rng = np.random.default_rng(3)
    frames = rng.integers(0, 256, (5, 16, 16, 3), dtype=np.uint8)
    folder = tmp_path / "frames"
    folder.mkdir()
    for k, frame in enumerate(frames[:4]):
        Image.fromarray(frame[..., ::-1]).save(folder / f"{k + 8}.png")
    np.save(folder / "12.npy", frames[4])
    np.save(folder / "background.npy", frames[0])
    expected = Emulator(model.pipeline).run(frames).force_n
    csv_file = tmp_path / "forces.csv"
    arguments = ("run", colours, "--via", "emulator", "--source", folder, "--no-progress")
    succeed(*arguments, "--csv", csv_file, "--batch", 2)
    np.testing.assert_allclose(forces(csv_file), expected, rtol=1e-8)

    # Against a background that is taken first: that of the folder.
    succeed(*arguments, "--csv", csv_file, "--force", "--capture-background", "--frames", 3)
    expected = Emulator(model.pipeline.replace(background=frames[0])).run(frames[:3]).force_n
    np.testing.assert_allclose(forces(csv_file), expected, rtol=1e-8)

    video = tmp_path / "frames.mkv"
    with av.open(str(video), "w") as container:
        stream = container.add_stream("ffv1", rate=30, options={"slices": "4"})
        stream.width, stream.height, stream.pix_fmt = 16, 16, "bgr0"
        for frame in frames:
            for packet in stream.encode(av.VideoFrame.from_ndarray(frame, "bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    succeed(
        "run", colours, "--via", "emulator", "--source", video, "--no-progress", "--csv", csv_file, "--force"
    )
    expected = Emulator(model.pipeline).run(frames).force_n
    np.testing.assert_allclose(forces(csv_file), expected, rtol=1e-8)


def test_calibration(colours, tmp_path):
    """The file of `fastac calibration` for boards and the simulation; its bundle for the emulator."""
    model = bundles.load(colours / "bundle")
    first = replace(model.pipeline.layers[0], bias=model.pipeline.layers[0].bias + 3)
    bundles.save(tmp_path / "new", model.pipeline.replace(layers=(first, *model.pipeline.layers[1:])), {})
    rng = np.random.default_rng(3)
    folder = tmp_path / "frames"
    folder.mkdir()
    frames = rng.integers(0, 256, (2, 16, 16, 3), dtype=np.uint8)
    for k, frame in enumerate(frames):
        np.save(folder / f"{k}.npy", frame)
    expected = Emulator(bundles.load(tmp_path / "new").pipeline).run(frames).force_n
    csv_file = tmp_path / "forces.csv"
    succeed(
        *("run", colours, "--via", "emulator", "--source", folder, "--no-progress"),
        *("--calibration", tmp_path / "new", "--csv", csv_file),
    )
    np.testing.assert_allclose(forces(csv_file), expected, rtol=1e-8)
    (tmp_path / "bad.bin").write_bytes(b"12345")
    message = fail(
        "run", colours, "--via", "emulator", "--source", folder, "--calibration", tmp_path / "bad.bin"
    )
    assert message == f"{tmp_path / 'bad.bin'}: 5 bytes: expected words of 4 bytes"


class TestRefusals:
    def test_files_that_exist(self, built, tmp_path):
        path = tmp_path / "forces.csv"
        path.write_text("mine")
        message = fail("run", built, "--via", "emulator", "--csv", path)
        assert message == f"{path}: exists already; --force replaces it"
        assert path.read_text() == "mine"

    def test_a_board_without_packets(self, built):
        message = fail("run", built, "--via", "uio")
        wanted = "a DMA needs hardware.streams = 'packets' in the scene, or --verilog with the folder of"
        assert message == f"--via uio: hardware.streams = 'video': {wanted} fastac vivado"

    def test_no_board_here(self, colours, tmp_path):
        np.save(tmp_path / "0.npy", np.zeros((16, 16, 3), np.uint8))
        arguments = ("run", colours, "--source", tmp_path)
        assert "no device fastac_0" in fail(*arguments, "--via", "uio")
        assert fail(*arguments, "--via", "pynq").startswith("--via pynq: --bitstream: missing")
        message = fail(*arguments, "--via", "pynq", "--bitstream", tmp_path / "a.bit")
        assert message == "pynq: no such package; it is on the image of a PYNQ board"

    def test_no_verilog(self, colours, tmp_path):
        shutil.copytree(colours / "bundle", tmp_path / "bundle")
        message = fail("run", tmp_path, "--via", "emulator", "--source", colours)
        assert message.startswith(
            f"{tmp_path}/verilog/hardware.json: No such file or directory; write it with"
        )

    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda p: "nothing.mp4", "nothing.mp4: no such file or folder"),
            (lambda p: p.mkdir(), "{}: no frames: expected files of .npy, .png"),
            (lambda p: np.save(f"{p}.npy", np.zeros(3)), "{}.npy: not a readable video"),
        ],
        ids=["missing", "empty", "no video"],
    )
    def test_sources(self, colours, tmp_path, make, message):
        path = tmp_path / "source"
        name = make(path) or (path if path.exists() else path.with_suffix(".npy"))
        found = fail("run", colours, "--via", "emulator", "--source", name)
        assert found.startswith(message.format(path))

    def test_frames_that_are_not_the_sensor_s(self, built, colours, tmp_path):
        message = fail("run", built, "--via", "emulator", "--source", "camera:77")
        assert "camera:77" in message
        np.save(tmp_path / "0.npy", np.zeros((16, 18, 3), np.uint8))
        message = fail("run", colours, "--via", "emulator", "--source", tmp_path)
        assert message == f"{tmp_path}/0.npy: uint8 (16, 18, 3): expected uint8 (16, 16, 3)"

    def test_another_bundle_s_hardware(self, built, colours, tmp_path):
        message = fail(
            "run", built, "--via", "emulator", "--verilog", colours / "verilog", "--source", built / "data.h5"
        )
        assert message.startswith(f"{colours / 'verilog'}")


def test_ctrl_c_loses_nothing_that_has_arrived(built, tmp_path):
    """Frames without an end; the process is interrupted, and every result that it has had is in the file."""
    csv_file = tmp_path / "forces.csv"
    endless = tmp_path / "endless.py"
    endless.write_text(
        "import itertools, sys\n"
        "from fastac.driver import sources\n"
        "opened = sources.open_source\n"
        "def endless(*arguments, **settings):\n"
        "    source = opened(*arguments, **settings)\n"
        "    frames = list(source.frames)\n"
        "    return sources.Source(itertools.cycle(frames))\n"
        "sources.open_source = endless\n"
        "from fastac.cli.main import main\n"
        "main(sys.argv[1:])\n"
    )
    arguments = ["run", built, "--via", "emulator", "--csv", csv_file]
    process = subprocess.Popen(
        [sys.executable, endless, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 60
    while not (csv_file.exists() and len(csv_file.read_text().splitlines()) > 20):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    printed, shown = process.communicate(timeout=30)
    assert process.returncode == 130, shown
    rows = table(csv_file)
    assert printed.startswith(f"{len(rows)} frames in ")
    assert [int(row["frame"]) for row in rows] == list(range(1, len(rows) + 1))
    assert "F_z" in shown  # a line a second, as this is no terminal


def test_help():
    assert "Example: fastac run build/paper --via sim" in run("run", "--help").output
