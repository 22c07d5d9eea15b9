"""cocotb bench of the whole hardware: frames in through AXI, depth, normals and force out.

Settings are in the folder BENCH: `settings.json` and `frames.npy`. Everything that leaves is written to
`outputs.npz` there, for `sim.top` to compare with the integer reference; what only the bench can see, the
bus rules and the exact cycle counts, is asserted or recorded here.
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
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

from fastac.gateware.bus.register_map import REGISTERS
from fastac.sim.benches.host import read, write

FOLDER = Path(os.environ["BENCH"])
SET = json.loads((FOLDER / "settings.json").read_text())
ADDRESS = {register.name: register.offset for register in REGISTERS}
LINGER = SET["linger_cycles"]
"""Clocks after the last expected beat in which no other may come."""


def frame_words(frame: np.ndarray, lanes: int) -> list[int]:
    """One image (H, W, C) as stream words, lane 0 and channel 0 lowest."""
    octets = frame.reshape(-1, lanes * frame.shape[-1])
    return [int.from_bytes(beat.tobytes(), "little") for beat in octets]


def frame_beats(frame: np.ndarray, lanes: int) -> list[tuple[int, int, int]]:
    """One image (H, W, C) as beats (word, end of line, start of frame)."""
    line = frame.shape[1] // lanes
    words = frame_words(frame, lanes)
    return [(word, int(k % line == line - 1), int(k == 0)) for k, word in enumerate(words)]


class Sink:
    """Takes an AXI4-Stream and keeps words, markers and the clock of each transfer.

    What is offered must stay as it is until it is taken, unless `lenient`.
    """

    def __init__(self, dut, prefix: str, octets: int):
        self.octets, self.lenient, self.prefix = octets, False, prefix
        self.data, self.last, self.user, self.keep, self.at = bytearray(), [], [], [], []
        names = [k for k in ("tdata", "tlast", "tuser", "tkeep") if hasattr(dut, f"{prefix}_{k}")]
        self.valid, self.ready = getattr(dut, f"{prefix}_tvalid"), getattr(dut, f"{prefix}_tready")
        self.ports = {k: getattr(dut, f"{prefix}_{k}") for k in names}
        self._open = None
        self._held = None

    def open(self, is_open: bool) -> None:
        """Whether the next offer is taken."""
        if is_open != self._open:
            self.ready.value = int(is_open)
            self._open = is_open

    def sample(self, cycle: int) -> None:
        if not int(self.valid.value):
            assert self._held is None or self.lenient, f"clock {cycle}: {self.prefix} withdrew an offer"
            self._held = None
            return
        offer = {k: int(port.value) for k, port in self.ports.items()}
        assert self._held in (None, offer) or self.lenient, f"clock {cycle}: {self.prefix} changed an offer"
        self._held = None if self._open else offer
        if self._open:
            self.data += offer["tdata"].to_bytes(self.octets, "little")
            self.last.append(offer["tlast"])
            self.user.append(offer["tuser"])
            self.keep.append(offer.get("tkeep", 0))
            self.at.append(cycle)

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        return {
            f"{name}_words": np.frombuffer(bytes(self.data), dtype="<i4"),
            f"{name}_last": np.array(self.last, np.int8),
            f"{name}_user": np.array(self.user, np.int32),
            f"{name}_keep": np.array(self.keep, np.int64),
            f"{name}_at": np.array(self.at, np.int64),
        }


class Streams:
    """What is queued goes into `s_axis`, what comes out is kept, clock by clock, with the pauses of `stall`.

    stall : probability per clock that the source waits before its next offer, and that a sink is not ready
    limit : no more beats than these are offered; closed : the sinks take nothing
    """

    def __init__(self, dut, stall: tuple[float, float] = (0, 0), seed: int = 1):
        self.dut, self.rng, self.stall = dut, random.Random(seed), stall
        self.beats: list[tuple[int, int, int]] = []  # (word, end of line, start of frame)
        self.taken_at: list[int] = []  # the clock in which each was accepted
        self.interrupt_at: list[int] = []  # the clocks in which the interrupt rose
        self.cycle, self.limit, self.closed = 0, sys.maxsize, False
        self.sinks = {name: Sink(dut, f"m_axis_{name}", octets) for name, octets in SET["outputs"].items()}
        for name in ("tdata", "tvalid", "tlast", "tuser"):
            getattr(dut, f"s_axis_{name}").value = 0

    async def run(self) -> None:
        """To be started in the background; ends with the test."""
        dut, rng = self.dut, self.rng
        slow_in, slow_out = self.stall
        offered, level = 0, 0
        valid = False
        while True:
            if offered == len(self.taken_at):
                offer = offered < min(len(self.beats), self.limit) and rng.random() >= slow_in
                if offer:
                    word, last, start = self.beats[offered]
                    dut.s_axis_tdata.value = word
                    dut.s_axis_tlast.value = last
                    dut.s_axis_tuser.value = start
                    offered += 1
                if offer != valid:
                    valid = offer
                    dut.s_axis_tvalid.value = int(valid)
            for sink in self.sinks.values():
                sink.open(rng.random() >= slow_out and not self.closed)
            await ReadOnly()
            if valid and int(dut.s_axis_tready.value):
                self.taken_at.append(self.cycle)
            for sink in self.sinks.values():
                sink.sample(self.cycle)
            before, level = level, int(dut.interrupt.value)
            if level and not before:
                self.interrupt_at.append(self.cycle)
            await RisingEdge(dut.clk)
            self.cycle += 1


class Host:
    """What a driver does: wait for the interrupt, read force and registers, acknowledge."""

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
        """The raw accumulators of the last force."""
        words = []
        for axis in SET["axes"]:
            low = await self.read(f"FORCE_{axis.upper()}_LOW")
            value = await self.read(f"FORCE_{axis.upper()}_HIGH") << 32 | low
            words.append(value - (1 << 64) if value >> 63 else value)
        return words

    async def serve(self) -> None:
        """To be started in the background; ends with the test."""
        while True:
            if not int(self.dut.interrupt.value):
                await RisingEdge(self.dut.interrupt)
            force = await self.force()
            self.registers.append({name: await self.read(name) for name in SET["registers"]})
            self.forces.append(force)
            await self.write("INTERRUPT_STATUS", 1)


async def start(dut, stall: tuple[float, float] = (0, 0)) -> tuple[Streams, Host]:
    """Clock, reset, streams and host; frames are let in and the identity is that of the bundle."""
    Clock(dut.clk, SET["period_ps"], unit="ps").start()
    dut.rst.value = 1
    streams = Streams(dut, stall)
    host = Host(dut, AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axil"), dut.clk, dut.rst))
    await ClockCycles(dut.clk, 3)
    dut.rst.value = 0
    await RisingEdge(dut.clk)
    await host.write("CONTROL", 0b1001)
    identity = {name: await host.read(name) for name in SET["identity"]}
    assert identity == SET["identity"], f"identity {identity}: not that of the bundle"
    cocotb.start_soon(streams.run())
    return streams, host


@cocotb.test(timeout_time=SET["timeout_cycles"] * SET["period_ps"], timeout_unit="ps")
async def frames_back_to_back(dut):
    frames = np.load(FOLDER / "frames.npy", allow_pickle=False)
    streams, host = await start(dut, SET["stall"])
    cocotb.start_soon(host.serve())
    streams.beats += [beat for frame in frames for beat in frame_beats(frame, SET["lanes"])]
    while len(host.forces) < len(frames) or any(
        len(sink.data) < SET["octets"][name] for name, sink in streams.sinks.items()
    ):
        await ClockCycles(dut.clk, max(LINGER, 1))
        (FOLDER / "cycle").write_text(str(streams.cycle))
    cycles = streams.cycle
    await ClockCycles(dut.clk, LINGER)
    per_frame = len(streams.beats) // len(frames)
    outputs = {
        "first_at": np.array(streams.taken_at[::per_frame], np.int64),
        "last_at": np.array(streams.taken_at[per_frame - 1 :: per_frame], np.int64),
        "interrupt_at": np.array(streams.interrupt_at, np.int64),
        "force_raw": np.array(host.forces, np.int64),
    }
    for name, sink in streams.sinks.items():
        outputs |= sink.arrays(name)
    np.savez(FOLDER / "outputs.npz", **outputs)
    counts = {name: await host.read(name) for name in ("ERRORS", "FRAME_COUNT", "FRAME_ERRORS")}
    (FOLDER / "registers.json").write_text(
        json.dumps({"frames": host.registers, **{k.lower(): v for k, v in counts.items()}, "cycles": cycles})
    )
