"""Half-widths of the intervals around forces, from the hardware to newtons, files and lines."""

import csv
import json

import numpy as np
import pytest
from described_hardware import content, described, frames_of, write_hardware

from fastac.driver.description import DescriptionError, parse
from fastac.driver.driver import Driver
from fastac.driver.live import line
from fastac.driver.packets import join
from fastac.driver.recorder import CsvRecorder
from fastac.driver.transports.emulator import EmulatorTransport
from fastac.driver.transports.simulation import SimulationTransport, Simulator
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import random_bundle, scene

WITH_DEPTH = {
    "outputs": ("depth", "force_x", "force_z"),
    "mode": "difference",
    "kernel": "collapsed",
    "lanes": 2,
}
FORCE_ALONE = {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": 4}


def made(folder, wanted: dict, **more):
    bundle = random_bundle(folder / "bundle", scene(**wanted, **more, coverage=0.9))
    return bundle, described(bundle), frames_of(bundle, 6)


def assert_half_widths(driver, bundle, frames):
    expected = Emulator(bundle.pipeline).run(frames)
    found = join(list(driver.frames(frames)))
    np.testing.assert_array_equal(found.force_raw, expected.force_raw)
    np.testing.assert_array_equal(found.force_half_width_raw, expected.force_half_width_raw)
    np.testing.assert_allclose(found.force_half_width_n, expected.force_half_width_n, rtol=1e-12)
    return found


@pytest.mark.parametrize("wanted", [WITH_DEPTH, FORCE_ALONE], ids=["with depth", "force alone"])
def test_half_widths_in_newtons(tmp_path, wanted):
    bundle, description, frames = made(tmp_path, wanted, streams="packets")
    assert description.interval.coverage == 0.9
    assert description.record.bytes == description.results.record_bytes == 128
    driver = Driver(EmulatorTransport(bundle, description), description)
    found = assert_half_widths(driver, bundle, frames)
    for axis, half in zip(found.force_axes, found.force_half_width_raw[-1], strict=True):
        low = driver.registers.read(f"HALF_WIDTH_{axis.upper()}_LOW")
        assert driver.registers.read(f"HALF_WIDTH_{axis.upper()}_HIGH") << 32 | low == half
    assert driver.registers.read("HALF_WIDTH_SEQUENCE") == driver.registers.read("FORCE_SEQUENCE")
    recorder = CsvRecorder(tmp_path / "forces.csv", description)
    recorder.add(found[2])
    recorder.close()
    with open(tmp_path / "forces.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    axes = found.force_axes
    given = [float(row[f"force_{axis}_half_width_n"]) for axis in axes]
    assert given == pytest.approx(found.force_half_width_n[2], rel=1e-8)
    for axis, half in zip(axes, found.force_half_width_n[2], strict=True):
        assert f" ± {half:.3f} N" in line(found[2], 1.0), axis


@pytest.mark.full
@pytest.mark.parametrize("streams", ["packets", "video"])
def test_half_widths_of_simulated_hardware(tmp_path, streams):
    bundle, description, frames = made(tmp_path, WITH_DEPTH, streams=streams)
    write_hardware(bundle, tmp_path / "verilog")
    with Simulator(tmp_path / "verilog", tmp_path / "simulator") as simulator:
        transport = SimulationTransport(description, simulator.connect())
        assert_half_widths(Driver(transport, description), bundle, frames)
        transport.close()


def test_records_of_another_size_are_refused(tmp_path):
    bundle, *_ = made(tmp_path, WITH_DEPTH, streams="packets")
    found = content(bundle)
    for change, message in (
        ({"interval": None}, "results.record_bytes = 128: expected 64"),
        ({"force": None}, "interval: expected a force"),
    ):
        with pytest.raises(DescriptionError, match=message):
            parse(json.dumps(found | change))
