"""What only a simulated board can show: DMAs that fail, the records' FIFO, rates, processes that die."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from described_hardware import described, frames_of, write_hardware

from fastac.driver.driver import Driver, DriverError
from fastac.driver.transports.dma_transport import MOST_IN_FLIGHT
from fastac.driver.transports.simulation import SimulationTransport, Simulator
from fastac.driver.transports.transport import ClosedError, TransportError
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import random_bundle, scene
from fastac.sim.board.protocol import READ, RUN
from fastac.sim.dma.axi_dma import Timing


def test_as_many_frames_may_be_in_flight_as_the_core_holds():
    assert MOST_IN_FLIGHT == FRAMES_IN_FLIGHT - 1


def test_a_dma_that_gets_more_than_it_may(simulation, description, frames, expected):
    """It halts with an error of its own, which has a name; after a reset all is well."""
    driver = Driver(simulation, description)
    stream = simulation._streams["depth"]
    list(driver.frames(frames[:1]))
    size = stream.slots.size
    stream.slots.size = 64
    simulation.reset_dma()  # the next transfer is too short for a packet
    stream.slots.size = size
    results = list(driver.frames(frames))
    lost = sum(bool(found.lost) for found in results)
    assert 1 <= lost <= simulation.frames_in_flight
    assert all(found.lost for found in results[:lost])
    for k, found in enumerate(results[lost:], lost):
        assert found.force_raw.tolist() == expected.force_raw[k].tolist()
    assert driver.trouble.startswith("axi_dma_0 S2MM: DMA error: internal (DMASR = 0x")
    assert driver.counts.dma_errors == 1


def test_a_frame_that_is_cut(simulation, description, frames, expected):
    """The DMA is reset inside a frame: the driver finds back to where a frame begins."""
    driver = Driver(simulation, description)
    list(driver.frames(frames[:1]))
    simulation.send(driver._octets(frames[0]))
    simulation.board.ask(RUN, 40, 0)  # some of the frame's 128 beats go in
    driver.soft_reset()
    for k, found in enumerate(driver.frames(frames)):
        assert not found.lost
        assert found.force_raw.tolist() == expected.force_raw[k].tolist()
    # And by a driver that died in the middle, which its successor finds.
    simulation.send(driver._octets(frames[0]))
    simulation.board.ask(RUN, 40, 0)
    simulation.reset_dma()
    for k, found in enumerate(Driver(simulation, description).frames(frames)):
        assert not found.lost
        assert found.force_raw.tolist() == expected.force_raw[k].tolist()


@pytest.mark.full
def test_two_hundred_frames_at_the_full_rate(simulation, description, frames):
    """None is lost; frames wait for the DMA's own clocks only (`Timing` in sim/dma/axi_dma.py)."""
    driver = Driver(simulation, description)
    results = list(driver.frames(frames[k % len(frames)] for k in range(200)))
    assert not any(found.lost for found in results)
    assert driver.counts.received == 200
    clocks = np.diff([int(found.records["time"]) for found in results])
    assert description.frame_beats == 128
    timing, packet_beats = Timing(), description.outputs[0].format.beats
    in_dma = max(128 + timing.fetch, packet_beats + timing.write + timing.response + timing.between)
    assert np.median(clocks) <= in_dma + 10


def test_interrupt_and_time_pass_in_clocks(simulation, description):
    driver = Driver(simulation, description)
    for _ in range(3):  # the packet of the restart's frame is still on its way
        simulation.wait_interrupt(1000 / 150e6)
    start, wall = simulation.now_s(), time.monotonic()
    assert not simulation.wait_interrupt(1000 / 150e6)
    assert 990 <= (simulation.now_s() - start) * 150e6 <= 1100
    assert time.monotonic() - wall < 5
    before = driver.registers.read_long("TIME")
    time.sleep(0.05)  # no clock passes while nobody asks
    assert driver.registers.read_long("TIME") - before < 100


def test_refused_accesses(simulation, description):
    with pytest.raises(TransportError, match=r"address 0x.*: nothing is there"):
        simulation.board.ask(READ, 0, 0x1234)
    with pytest.raises(TransportError, match="memory"):
        simulation.memory.read(1 << 30, 16)
    with pytest.raises(TransportError, match=r"register 0x2c: this DMA has none there"):
        simulation.board.ask(READ, 0, 0xA001_002C)
    assert not Driver(simulation, description).registers.read("STATUS", "busy")


def test_records_that_no_packet_carries(tmp_path):
    """Normals end before the force is there, so it comes through the registers' FIFO."""
    wanted = scene(("normals", "force_z"), solver="adjoint", lanes=4, streams="packets")
    bundle = random_bundle(tmp_path / "bundle", wanted)
    write_hardware(bundle, tmp_path / "verilog")
    frames, description = frames_of(bundle, 6), described(bundle)
    expected = Emulator(bundle.pipeline).run(frames)
    assert description.record_at is None
    with Simulator(tmp_path / "verilog", tmp_path / "simulator") as simulator:
        transport = SimulationTransport(description, simulator.connect())
        driver = Driver(transport, description)
        for k, found in enumerate(driver.frames(frames)):
            assert found.force_raw.tolist() == expected.force_raw[k].tolist()
            np.testing.assert_array_equal(found.words("normals"), expected.normal_words[k])
            np.testing.assert_allclose(found.normals, expected.normals[k], atol=1e-6)
        transport.close()


class TestDeath:
    def test_the_simulator_dies(self, verilog, simulator_folder, description, frames):
        with Simulator(verilog, simulator_folder) as simulator:
            transport = SimulationTransport(description, simulator.connect())
            driver = Driver(transport, description)
            results = driver.frames(frames)
            next(results)
            os.killpg(simulator.process.pid, signal.SIGKILL)
            with pytest.raises(ClosedError, match=rf"the simulation has ended.*; see {simulator.log}"):
                list(results)
            transport.close()

    def test_the_driver_dies(self, verilog, simulator_folder):
        """The simulator's process ends by itself when its host is gone."""
        program = (
            "import sys, os, pathlib\n"
            "from fastac.driver.transports.simulation import Simulator\n"
            "simulator = Simulator(*map(pathlib.Path, sys.argv[1:]))\n"
            "simulator.connect()\n"
            "print(simulator.process.pid, flush=True)\n"
            "os.kill(os.getpid(), 9)\n"
        )
        command = [sys.executable, "-c", program, str(verilog), str(simulator_folder)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        child, end = int(done.stdout), time.monotonic() + 20
        while _runs(child):
            assert time.monotonic() < end, "the simulator goes on without a host"
            time.sleep(0.1)

    def test_verilog_that_does_not_compile(self, verilog, tmp_path):
        folder = tmp_path / "verilog"
        folder.mkdir()
        (folder / "hardware.json").write_bytes((verilog / "hardware.json").read_bytes())
        with pytest.raises(TransportError, match=r"fastac.v: no such file; write it with fastac verilog"):
            Simulator(folder, tmp_path / "simulator")
        (folder / "fastac.v").write_text("module fastac(;")
        with pytest.raises(ClosedError, match=r"the simulator did not start; see .*board.log"):
            Simulator(folder, tmp_path / "simulator")


def _runs(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_several_threads_share_the_board(simulation, description):
    """Each gets the answers to its own questions."""
    driver = Driver(simulation, description)
    names = ("ID", "VERSION", "GEOMETRY", "CAPABILITIES")
    values = {name: driver.registers.read(name) for name in names}
    wrong = []

    def ask(name: str) -> None:
        wrong.extend(1 for _ in range(20) if driver.registers.read(name) != values[name])

    threads = [threading.Thread(target=ask, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    with pytest.raises(DriverError, match="ID = 0x"):
        Driver(_Elsewhere(simulation), description)


class _Elsewhere:
    """A transport to registers that are none of ours."""

    def __init__(self, transport):
        self._transport = transport

    def __getattr__(self, name):
        return getattr(self._transport, name)

    def read(self, offset: int) -> int:
        return 0xDEADBEEF
