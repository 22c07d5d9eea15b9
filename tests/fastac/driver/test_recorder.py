"""Files and lines of results: lost frames, units, and what a process that is killed leaves behind."""

import csv
import io

import h5py
import numpy as np
import pytest

from fastac.driver.driver import Driver
from fastac.driver.live import Live, line
from fastac.driver.packets import nothing
from fastac.driver.recorder import CsvRecorder, Hdf5Recorder
from fastac.driver.transports.emulator import EmulatorTransport


@pytest.fixture
def results(bundle, description, frames):
    """Three results, the second of which was lost."""
    driver = Driver(EmulatorTransport(bundle, description), description)
    first, second, third = driver.frames(frames[[0, 1, 7]])
    return [first, nothing(description, int(second.frame), 0.5), third]


def test_csv(results, description, tmp_path):
    recorder = CsvRecorder(tmp_path / "deep" / "forces.csv", description)
    for found in results:
        recorder.add(found)
    recorder.close()
    with open(tmp_path / "deep" / "forces.csv", newline="") as file:
        first, lost, third = csv.DictReader(file)
    forces = [float(first[f"force_{axis}_n"]) for axis in "xyz"]
    assert forces == pytest.approx(results[0].force_n, rel=1e-8)
    assert (first["lost"], first["suspect"], first["reasons"]) == ("0", "0", "")
    assert {key: value for key, value in lost.items() if value} == {"frame": "2", "lost": "1"}
    assert third["suspect"] == "1"
    assert "detail" in third["reasons"].split()
    assert "frame_suspect" in third["errors"].split()


def test_hdf5_is_readable_while_it_is_written(results, description, tmp_path):
    path = tmp_path / "results.h5"
    recorder = Hdf5Recorder(path, description, images=True, about={"via": "emulator"})
    for found in results:
        recorder.add(found)
    recorder._flushed = 0.0  # the time to write has come
    recorder.add(results[0])
    with h5py.File(path, "r", swmr=True) as file:
        assert file["lost"][:].tolist() == [False, True, False, False]
        assert np.isnan(file["force_z_n"][1])
        np.testing.assert_array_equal(file["depth_mm"][2], results[2].depth_mm)
        assert not file["depth_mm"][1].any()
        assert file["force_z_n"].attrs["unit"] == "N"
        assert file["host_latency_s"].attrs["unit"] == "s"
        assert list(file["validity"].attrs["bits"]) == list(description.validity)
        assert file.attrs["via"] == "emulator"
    recorder.close()


def test_numbers_alone(results, description, tmp_path):
    recorder = Hdf5Recorder(tmp_path / "results.h5", description, images=False, about={})
    recorder.add(results[0])
    recorder.close()
    with h5py.File(tmp_path / "results.h5") as file:
        assert "depth_mm" not in file
        assert file["frame"][:].tolist() == [1]


def test_live(results):
    shown = io.StringIO()
    live = Live(shown)
    for found in results:
        live.add(found)
    live.close()
    assert shown.getvalue().splitlines() == [line(results[0], 0.0)]
    summary = live.summary()
    assert summary[0].endswith("s: 1 lost, 0 bad, 1 suspect")
    assert "first pixel to result in the hardware: " in summary[2]
    assert line(results[1], 3.0) == "frame 2  LOST  3.0 frames/s"
    assert "suspect (" in line(results[2], 0.0)
    assert "N  " in line(results[0], 0.0)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_has_one_line_that_is_refreshed(results, monkeypatch):
    monkeypatch.setattr("fastac.driver.live.TERMINAL_S", -1.0)
    shown = Terminal()
    live = Live(shown)
    for found in results:
        live.add(found)
    live.close()
    assert shown.getvalue().count("\r") == 3
    assert shown.getvalue().count("\n") == 1
    quiet = Terminal()
    silent = Live(quiet, enabled=False)
    silent.add(results[0])
    silent.close()
    assert quiet.getvalue() == ""
