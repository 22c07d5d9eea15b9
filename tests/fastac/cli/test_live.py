"""`fastac live` as a user types it: what it shows where, the file of every frame, and its refusals."""

import os
import re
import signal
import subprocess
import sys
from urllib.parse import urlsplit

import pytest
from command_line import fail, run, succeed
from websockets.sync.client import connect

from fastac.streaming.views import page_message, rerun_view

WAIT_S = 60


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def test_every_frame_is_saved(tiny_folder, tiny_file, tmp_path):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    path = tmp_path / "new" / "tiny.rrd"
    arguments = ("live", tiny_folder, "--source", tiny_file, "--split", "test", "--view", "none", "--no-pace")
    printed = succeed(*arguments, "--save", path, "--no-progress").stdout.splitlines()
    assert printed[0].startswith("8 frames in ")
    assert printed[-1] == str(path)
    chunks = [
        chunk.to_record_batch() for chunk in RrdReader(str(path)).stream() if chunk.entity_path == "/depth"
    ]
    frames = [
        n for chunk in chunks if "frame" in chunk.schema.names for n in chunk.column("frame").to_pylist()
    ]
    assert sorted(frames) == list(range(8))
    assert fail(*arguments, "--save", path) == f"{path}: exists already; --force replaces it"
    succeed(*arguments, "--save", path, "--force", "--frames", 2, "--no-progress")


def test_the_view_that_is_chosen_says_why(tiny_folder, tiny_file, monkeypatch):
    arguments = ("live", tiny_folder, "--source", tiny_file, "--frames", 3, "--no-pace", "--no-progress")
    done = succeed(*arguments)
    assert "view: page: there is no display for Rerun's viewer" in done.stderr
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/\?token=\S{32}$", done.stdout, re.MULTILINE)
    assert "page: 0 shown, 0 left out" in done.stdout
    monkeypatch.setattr(rerun_view, "installed", lambda: False)
    assert "view: page: Rerun is not installed (pip install -e '.[view]')" in succeed(*arguments).stderr
    assert fail(*arguments, "--view", "rerun") == "rerun: not installed: pip install -e '.[view]'"
    assert fail(*arguments, "--save", "a.rrd") == "rerun: not installed: pip install -e '.[view]'"


def test_refusals(tiny_folder, tiny_file, tmp_path):
    known = ("live", tiny_folder, "--source", tiny_file)
    assert fail(*known, "--view", "none", "--open") == "--open: there is no page; add --view page"
    assert (
        fail(*known, "--save", tmp_path / "a.mp4") == f"{tmp_path}/a.mp4: expected a name that ends in .rrd"
    )
    assert fail(*known, "--view", "page", "--host", "203.0.113.1").startswith("203.0.113.1:0: ")
    if rerun_view.installed():
        assert fail(*known, "--view", "rerun").startswith("rerun: no display here")
        assert "no Rerun viewer answers" in fail(*known, "--rerun-url", "rerun+http://127.0.0.1:9/proxy")
    assert fail("live", tmp_path, "--view", "none").startswith(str(tmp_path))
    assert fail("live", tiny_folder, "--source", "camera:77", "--view", "none").startswith("camera:77: gives")


def test_ctrl_c_ends_a_view_that_is_looked_at(tiny_folder, tiny_file):
    """A recording is played over and over; two browsers look at it; the process is interrupted."""
    program = [sys.executable, "-c", "from fastac.cli.main import main; main()", "live", tiny_folder]
    process = subprocess.Popen(
        [*program, "--source", tiny_file, "--view", "page", "--no-progress"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        url = urlsplit(process.stdout.readline().split()[1])
        address = f"ws://{url.netloc}/stream?{url.query}"
        with (
            connect(address, max_size=None, proxy=None) as one,
            connect(address, max_size=None, proxy=None) as two,
        ):
            for viewer in (one, two):
                topic, *_ = page_message.split(viewer.recv(timeout=WAIT_S))
                assert topic == b"about"
                for _ in range(3):
                    assert page_message.split(viewer.recv(timeout=WAIT_S))[0] == b"record"
                    viewer.send("next")
            os.kill(process.pid, signal.SIGINT)
            printed, errors = process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert errors == ""
    assert re.search(r"^\d+ frames in ", printed, re.MULTILINE)
    assert re.search(r"^first picture: \d+\.\d s after the command began$", printed, re.MULTILINE)


def test_help():
    assert "Example: fastac live build/gelsight" in run("live", "--help").output
