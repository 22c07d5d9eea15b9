"""One small design behind every transport: depth and three forces of 16 × 16 px, frames in packets.

Fixtures, which a conftest.py imports.
"""

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from board_stand_in import UioBoard, pynq_module
from described_hardware import described, frames_of, write_hardware

from fastac.driver.description import Description
from fastac.driver.transports.emulator import EmulatorTransport
from fastac.driver.transports.pynq import PynqTransport
from fastac.driver.transports.simulation import SimulationTransport, Simulator
from fastac.driver.transports.uio import UioTransport
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle, save
from fastac.models.random_bundle import random_bundle, scene

TRANSPORTS = ("emulator", "simulation", "uio", "pynq")


@pytest.fixture(scope="session")
def bundle(tmp_path_factory) -> Bundle:
    folder = tmp_path_factory.mktemp("driven") / "bundle"
    wanted = scene(("depth", "force_xyz"), mode="difference", kernel="collapsed", lanes=2, streams="packets")
    return random_bundle(folder, wanted)


@pytest.fixture(scope="session")
def recalibrated(bundle, tmp_path_factory) -> Bundle:
    """The same with another pixel network, which a calibration loads."""
    first = replace(bundle.pipeline.layers[0], bias=bundle.pipeline.layers[0].bias + 3)
    pipeline = bundle.pipeline.replace(layers=(first, *bundle.pipeline.layers[1:]))
    return save(tmp_path_factory.mktemp("driven") / "recalibrated", pipeline, {})


@pytest.fixture(scope="session")
def description(bundle) -> Description:
    return described(bundle)


@pytest.fixture(scope="session")
def frames(bundle):
    return frames_of(bundle, 8)


@pytest.fixture(scope="session")
def expected(bundle, frames):
    return Emulator(bundle.pipeline).run(frames)


@pytest.fixture(scope="session")
def verilog(bundle, tmp_path_factory) -> Path:
    """The folder of the design's Verilog and hardware.json."""
    folder = tmp_path_factory.mktemp("driven") / "verilog"
    write_hardware(bundle, folder)
    return folder


@pytest.fixture(scope="session")
def simulator_folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("driven") / "simulator"


@pytest.fixture(scope="session")
def simulation(verilog, description, simulator_folder):
    """The simulated board; one for all tests, which leave it as they find it but for FRAME_COUNT."""
    with Simulator(verilog, simulator_folder) as simulator:
        transport = SimulationTransport(description, simulator.connect())
        yield transport
        transport.close()


@pytest.fixture
def opened(request, bundle, recalibrated, description, tmp_path, monkeypatch):
    """`opened(name)`: a transport as a context manager."""

    @contextmanager
    def open_one(name: str):
        if name == "emulator":
            yield EmulatorTransport(bundle, description, calibrations=[recalibrated])
        elif name == "simulation":
            yield request.getfixturevalue("simulation")
        elif name == "uio":
            board = UioBoard(bundle, description, tmp_path / "board")
            transport = UioTransport(description, sys=board.sys, dev=board.dev, device=board.device)
            try:
                yield transport
            finally:
                transport.close()
                board.close()
        else:
            module = pynq_module(bundle, description, [recalibrated])
            monkeypatch.setitem(sys.modules, "pynq", module)
            yield PynqTransport(description, tmp_path / "design.bit")

    return open_one
