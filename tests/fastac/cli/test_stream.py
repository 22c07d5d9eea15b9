"""`fastac serve` and `fastac listen`, as two programs use them."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from command_line import fail, run, succeed
from described_hardware import frames_of, write_hardware

from fastac.models.random_bundle import random_bundle, scene
from fastac.sensor import dataset
from fastac.streaming.about import About
from fastac.streaming.client import connect
from fastac.streaming.record import StreamRecord
from fastac.streaming.server import Publisher

FASTAC = [sys.executable, "-c", "from fastac.cli.main import main; main()"]


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """A build folder of a sensor of 16 × 16 px with eight frames, and its Verilog."""
    folder = tmp_path_factory.mktemp("served") / "build"
    model = random_bundle(folder / "bundle", scene(("depth", "force_z"), mode="difference", lanes=2))
    dataset.write(
        folder / "data.h5",
        pitch_mm=model.scene.sensor.pitch_mm,
        channels=model.scene.sensor.channel_names,
        source="noise",
        background=model.pipeline.background,
        split=np.array(["test"] * 8),
        frames=frames_of(model, 8),
        force_n=np.zeros((8, 3)),
    )
    write_hardware(model, folder / "verilog")
    return folder


@pytest.fixture
def address(request) -> str:
    """A place for a stream that no other test has."""
    return f"ipc://@fastac-{os.getpid()}-{abs(hash(request.node.nodeid))}"


class Reader(threading.Thread):
    """Reads a stream to its end in a thread."""

    def __init__(self, address: str):
        super().__init__()
        self.address, self.records, self.about = address, [], None
        self.start()

    def run(self) -> None:
        with connect(self.address, timeout_s=120) as stream:
            self.about = stream.about
            self.records = list(stream)


@pytest.fixture
def offered():
    """`offered(address)`: a stream of five records is published there, as soon as somebody reads."""
    threads, ended = [], threading.Event()

    def offer(address: str) -> str:
        publisher = Publisher(address)
        sensor = ("s", "ab", 4, 4, ("B", "G", "R"), 0.1, (1, 1), ("z",), (), (), "sim", True, 100.0)
        publisher.announce(About(*sensor, "data.h5", 100.0))

        def publish() -> None:
            # A subscriber that asks for the description alone may be gone before it is seen here.
            while not publisher.subscribers and not ended.wait(0.001):
                pass
            for k in range(5):
                publisher.add(StreamRecord(k, 10 * k, force_n={"z": k / 4}, force_raw={"z": k}))
            publisher.close()

        threads.append(threading.Thread(target=publish))
        threads[-1].start()
        return publisher.address

    yield offer
    ended.set()
    for thread in threads:
        thread.join()


@pytest.mark.full
def test_emulator_and_simulation_serve_the_same_records(built, address):
    readers = {}
    for via in ("emulator", "sim"):
        reader = readers[via] = Reader(address)
        arguments = ("--bind", address, "--wait", 1, "--no-pace", "--no-progress", "--frames", 6)
        printed = succeed("serve", built, "--via", via, *arguments).stdout.splitlines()
        reader.join()
        assert printed[0] == f"random_bundle by {via} at {address}"
        assert printed[1].startswith("6 frames in ")
        assert printed[1].endswith(", 6 sent")
    emulated, simulated = (readers[via].records for via in readers)
    assert len(emulated) == 6
    assert [one.digest for one in emulated] == [one.digest for one in simulated]
    assert list(emulated[0].arrays) == ["depth_mm", "image"]
    hidden = (
        [one.timing.hardware_time_s for one in emulated],
        [one.timing.hardware_time_s for one in simulated],
    )
    assert hidden[0] != hidden[1]
    assert readers["sim"].about.source == str(built / "data.h5")


def test_options_say_what_is_sent(built, address):
    reader = Reader(address)
    options = ("--arrays", "none", "--fps", 50, "--no-pace", "--loop", "--frames", 10)
    succeed("serve", built, "--bind", address, "--wait", 1, "--no-progress", *options)
    reader.join()
    assert [one.source_time_ns for one in reader.records] == [20_000_000 * k for k in range(10)]
    assert {tuple(one.arrays) for one in reader.records} == {()}
    assert reader.about.frames_per_second == 50


def test_a_readable_line_for_a_mistake(built, tmp_path, address):
    publisher = Publisher("tcp://127.0.0.1:*")
    message = fail("serve", tmp_path / "nowhere", "--bind", publisher.address)
    assert message == f"{publisher.address}: Address already in use; name another with --bind"
    publisher.close()
    assert "expected an address such as" in fail("serve", built, "--bind", "5599")
    assert "nowhere" in fail("serve", tmp_path / "nowhere", "--bind", address)
    message = fail("serve", built, "--bind", address, "--arrays", "depth_mm,normals")
    assert message == "array 'normals': this stream can have depth_mm, image"
    found = run("serve", built, "--arrays", "heat")
    assert "'heat': expected all, none, or some of depth_mm,normals,force_map_n,image" in found.stderr
    assert fail("listen", address, "--timeout-s", 0.05).startswith(f"{address}: no stream within 0.05 s; is")


def test_ctrl_c_ends_the_stream_for_its_readers_too(built, address):
    options = ["--bind", address, "--loop", "--fps", "500", "--arrays", "none"]
    process = subprocess.Popen(
        [*FASTAC, "serve", str(built), *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with connect(address, timeout_s=120) as stream:
        for record in stream:
            if stream.received == 5:
                os.kill(process.pid, signal.SIGINT)
            last = record.frame
    printed, shown = process.communicate(timeout=60)
    assert process.returncode == 130, shown
    assert printed.splitlines()[-1].startswith(f"{last + 1} frames in ")
    assert "F_z" in shown  # a line a second, as this is no terminal


def test_lines_of_json(offered, address):
    found = succeed("listen", offered(address), "--digests")
    rows = [json.loads(line) for line in found.stdout.splitlines()]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3, 4]
    assert rows[3]["force_n"] == {"z": 0.75}
    assert rows[3]["digest"] == StreamRecord(3, 30, force_n={"z": 0.75}, force_raw={"z": 3}).digest
    assert found.stderr == "5 records, 0 missed\n"


def test_lines_of_a_table(offered, address):
    found = succeed("listen", offered(address), "--format", "csv", "--frames", 2)
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert [(row["frame"], row["force_z_n"]) for row in rows] == [("0", "0.0"), ("1", "0.25")]


def test_the_description_alone(offered, address):
    assert json.loads(succeed("listen", offered(address), "--about").stdout)["via"] == "sim"


def test_a_shell_that_has_read_enough(offered, address):
    command = subprocess.Popen(
        [*FASTAC, "listen", offered(address)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    command.stdout.close()
    shown = command.stderr.read().decode()
    command.stderr.close()
    assert command.wait(60) == 0
    assert shown == ""


def test_help():
    assert "Example: fastac serve build/paper --loop" in run("serve", "--help").output
    assert "Example: fastac listen tcp://127.0.0.1:5599" in run("listen", "--help").output
