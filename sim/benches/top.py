"""cocotb testbench of the top level: frames in through AXI4-Stream; normals, depth and force out.

The streams are video, or packets where the settings have `pixel_octets`, the bytes of a padded pixel.

Reads `settings.json` and `frames.npy` in the folder BENCH (an environment variable) and writes all outputs to
`outputs.npz` and `registers.json` there, which `fastac.sim.check_top` compares with the golden model. The AXI
handshake rules are asserted here, and exact clock cycles are recorded here. The drivers and monitors serve
the other testbenches of the top level too (top_testbench.py).
"""

import json
import os
import random
import sys
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge
from cocotb.utils import get_sim_time
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

from fastac.gateware.bus.register_map import REGISTERS
from fastac.sim.benches.host import read, write

FOLDER = Path(os.environ["BENCH"])
SETTINGS = json.loads((FOLDER / "settings.json").read_text())
ADDRESS = {register.name: register.offset for register in REGISTERS}
PIXEL_OCTETS = SETTINGS.get("pixel_octets")
"""Bytes of a padded pixel; None where the streams are video."""
LINGER = SETTINGS["linger_cycles"]
"""Clocks after the last expected beat in which no further beat may come."""


def frame_words(frame: np.ndarray, lanes: int) -> list[int]:
    """One image (H, W, C) as `tdata` words, lane 0 and channel 0 in the least significant bits.

    What pads a pixel is 0xA5, which the hardware must ignore.
    """
    if PIXEL_OCTETS:
        padding = [(0, 0), (0, 0), (0, PIXEL_OCTETS - frame.shape[-1])]
        frame = np.pad(frame, padding, constant_values=0xA5)
    octets = frame.reshape(-1, lanes * frame.shape[-1])
    return [int.from_bytes(beat.tobytes(), "little") for beat in octets]


def frame_beats(frame: np.ndarray, lanes: int) -> list[tuple[int, int, int]]:
    """One image (H, W, C) as beats (tdata, tlast: end of line or packet, tuser: start of frame)."""
    line = frame.shape[1] // lanes
    words = frame_words(frame, lanes)
    if PIXEL_OCTETS:
        return [(word, int(k == len(words) - 1), 0) for k, word in enumerate(words)]
    return [(word, int(k % line == line - 1), int(k == 0)) for k, word in enumerate(words)]


class Sink:
    """Monitor of an AXI4-Stream output: records words, markers and the clock cycle of each transfer.

    Asserts that a valid beat stays unchanged until it is accepted, except while `reset_expected`.
    """

    def __init__(self, dut, prefix: str, octets: int):
        self.octets, self.reset_expected, self.prefix = octets, False, prefix
        self.data, self.last, self.user, self.keep, self.cycles = bytearray(), [], [], [], []
        names = [k for k in ("tdata", "tlast", "tuser", "tkeep") if hasattr(dut, f"{prefix}_{k}")]
        self.valid, self.ready = getattr(dut, f"{prefix}_tvalid"), getattr(dut, f"{prefix}_tready")
        self.ports = {k: getattr(dut, f"{prefix}_{k}") for k in names}
        self._open = None
        self._held = None

    def open(self, is_open: bool) -> None:
        """Drive `tready`."""
        if is_open != self._open:
            self.ready.value = int(is_open)
            self._open = is_open

    def sample(self, cycle: int) -> None:
        """Check the handshake in this clock cycle, and record the beat if it is transferred."""
        if not int(self.valid.value):
            assert self._held is None or self.reset_expected, (
                f"clock {cycle}: {self.prefix} withdrew an offer"
            )
            self._held = None
            return
        offer = {k: int(port.value) for k, port in self.ports.items()}
        assert self._held in (None, offer) or self.reset_expected, (
            f"clock {cycle}: {self.prefix} changed an offer"
        )
        self._held = None if self._open else offer
        if self._open:
            self.data += offer["tdata"].to_bytes(self.octets, "little")
            self.last.append(offer["tlast"])
            self.user.append(offer.get("tuser", 0))
            self.keep.append(offer.get("tkeep", 0))
            self.cycles.append(cycle)

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """Everything recorded, with keys that start with `name`."""
        return {
            f"{name}_words": np.frombuffer(bytes(self.data), dtype="<i4"),
            f"{name}_last": np.array(self.last, np.int8),
            f"{name}_user": np.array(self.user, np.int32),
            f"{name}_keep": np.array(self.keep, np.uint64),
            f"{name}_at": np.array(self.cycles, np.int64),
        }


class Streams:
    """Driver of `s_axis` and monitors of all output streams, with random pauses.

    stall : probability per clock that the driver pauses before its next beat, and that a monitor is not ready
    pace : clocks from an accepted beat to the offer of the next one
    beats : queue of the driver; append to it
    limit : number of beats after which the driver pauses
    blocked : no monitor is ready
    """

    def __init__(self, dut, stall: tuple[float, float] = (0, 0), seed: int = 1, pace: int = 1):
        self.dut, self.rng, self.stall, self.pace = dut, random.Random(seed), stall, pace
        self.beats: list[tuple[int, int, int]] = []  # (tdata, tlast, tuser)
        self.accepted_at: list[int] = []  # clock cycle in which each was accepted
        self.interrupt_at: list[int] = []  # clock cycles in which the interrupt rose
        self.cycle, self.limit, self.blocked = 0, sys.maxsize, False
        self.sinks = {
            name: Sink(dut, f"m_axis_{name}", octets) for name, octets in SETTINGS["outputs"].items()
        }
        self.origin = 0  # clocks since reset at clock 0
        self.user = dut.s_axis_tkeep if PIXEL_OCTETS else dut.s_axis_tuser  # packets have no start of frame
        for signal in (dut.s_axis_tdata, dut.s_axis_tvalid, dut.s_axis_tlast, self.user):
            signal.value = 0

    async def run(self) -> None:
        """Drive and monitor until the test ends; start it as a background task."""
        dut, rng = self.dut, self.rng
        slow_in, slow_out = self.stall
        offered, level, rests_until = 0, 0, 0
        valid = False
        while True:
            if offered == len(self.accepted_at):
                waits = offered >= min(len(self.beats), self.limit) or self.cycle < rests_until
                offer = not waits and rng.random() >= slow_in
                if offer:
                    word, last, start = self.beats[offered]
                    dut.s_axis_tdata.value = word
                    dut.s_axis_tlast.value = last
                    self.user.value = start
                    offered += 1
                if offer != valid:
                    valid = offer
                    dut.s_axis_tvalid.value = int(valid)
            for sink in self.sinks.values():
                sink.open(rng.random() >= slow_out and not self.blocked)
            await ReadOnly()
            if valid and int(dut.s_axis_tready.value):
                self.accepted_at.append(self.cycle)
                rests_until = self.cycle + self.pace
            for sink in self.sinks.values():
                sink.sample(self.cycle)
            before, level = level, int(dut.interrupt.value)
            if level and not before:
                self.interrupt_at.append(self.cycle)
            await RisingEdge(dut.clk)
            self.cycle += 1


class Host:
    """The host's software: waits for the interrupt, reads force and registers, clears the interrupt."""

    def __init__(self, dut, master: AxiLiteMaster):
        self.dut, self.master = dut, master
        self.forces: list[list[int]] = []
        self.registers: list[dict[str, int]] = []

    async def read(self, name: str) -> int:
        value, response = await read(self.master, ADDRESS[name])
        assert response == 0, f"{name}: response {response}"
        return value

    async def write(self, name: str, value: int) -> None:
        assert await write(self.master, ADDRESS[name], value) == 0, f"{name}: write refused"

    async def force(self) -> list[int]:
        """Raw accumulators of the last force, one per axis."""
        words = []
        for axis in SETTINGS["axes"]:
            low = await self.read(f"FORCE_{axis.upper()}_LOW")
            value = await self.read(f"FORCE_{axis.upper()}_HIGH") << 32 | low
            words.append(value - (1 << 64) if value >> 63 else value)
        return words

    async def serve_interrupts(self) -> None:
        """Read force and registers after each interrupt; start it as a background task."""
        while True:
            if not int(self.dut.interrupt.value):
                await RisingEdge(self.dut.interrupt)
            force = await self.force()
            self.registers.append({name: await self.read(name) for name in SETTINGS["registers"]})
            self.forces.append(force)
            await self.write("INTERRUPT_STATUS", 1)

    async def records(self) -> list[int]:
        """The words of all records that wait behind the registers."""
        waiting = await self.read("RESULTS_WAITING")
        return [await self.read("RESULTS_WORD") for _ in range(SETTINGS["record_words"] * waiting)]


async def start(dut, stall: tuple[float, float] = (0, 0)) -> tuple[Streams, Host]:
    """Start clock, reset, streams and host; enable frames, and check that the identity is the bundle's.

    Without pauses, pixels come at the camera's pace; with pauses, as fast as the hardware takes them.
    """
    Clock(dut.clk, SETTINGS["period_ps"], unit="ps").start()
    dut.rst.value = 1
    streams = Streams(dut, stall, pace=1 if any(stall) else SETTINGS.get("pace_cycles", 1))
    host = Host(dut, AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axil"), dut.clk, dut.rst))
    await ClockCycles(dut.clk, 3)
    dut.rst.value = 0
    released = get_sim_time("ps")
    await RisingEdge(dut.clk)
    await host.write("CONTROL", 0b1001)
    identity = {name: await host.read(name) for name in SETTINGS["identity"]}
    assert identity == SETTINGS["identity"], f"identity {identity}: not that of the bundle"
    streams.origin = round((get_sim_time("ps") - released) / SETTINGS["period_ps"])
    cocotb.start_soon(streams.run())
    return streams, host


@cocotb.test(timeout_time=SETTINGS["timeout_cycles"] * SETTINGS["period_ps"], timeout_unit="ps")
async def frames_back_to_back(dut):
    frames = np.load(FOLDER / "frames.npy", allow_pickle=False)
    streams, host = await start(dut, SETTINGS["stall"])
    cocotb.start_soon(host.serve_interrupts())
    streams.beats += [beat for frame in frames for beat in frame_beats(frame, SETTINGS["lanes"])]
    while len(host.forces) < len(frames) or any(
        len(sink.data) < SETTINGS["octets"][name] for name, sink in streams.sinks.items()
    ):
        await ClockCycles(dut.clk, max(LINGER, 1))
        (FOLDER / "cycle").write_text(str(streams.cycle))
    cycles = streams.cycle
    await ClockCycles(dut.clk, LINGER)
    per_frame = len(streams.beats) // len(frames)
    outputs = {
        "first_at": np.array(streams.accepted_at[::per_frame], np.int64),
        "last_at": np.array(streams.accepted_at[per_frame - 1 :: per_frame], np.int64),
        "interrupt_at": np.array(streams.interrupt_at, np.int64),
        "force_raw": np.array(host.forces, np.int64),
        "origin": np.array(streams.origin, np.int64),
    }
    if PIXEL_OCTETS:
        outputs["in_fifo"] = np.array(await host.records(), "<u4")
    for name, sink in streams.sinks.items():
        outputs |= sink.arrays(name)
    np.savez(FOLDER / "outputs.npz", **outputs)
    counts = {name: await host.read(name) for name in ("ERRORS", "FRAME_COUNT", "FRAME_ERRORS")}
    (FOLDER / "registers.json").write_text(
        json.dumps({"frames": host.registers, **{k.lower(): v for k, v in counts.items()}, "cycles": cycles})
    )
