"""cocotb bench of the whole hardware: frames in through AXI, depth, normals and force out.

Settings are in the folder BENCH: `settings.json` and `frames.npy`. Everything that leaves is written to
`outputs.npz` there, for `sim.top` to compare with the integer reference; what only the bench can see, the
bus rules and the exact cycle counts, is asserted or recorded here.
"""

import json
import os
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

from gateware.register_map import REGISTERS
from sim.axi_lite import read, write

FOLDER = Path(os.environ["BENCH"])
SET = json.loads((FOLDER / "settings.json").read_text())
ADDRESS = {register.name: register.offset for register in REGISTERS}
WORD = 32


def frame_words(frame: np.ndarray, lanes: int) -> list[int]:
    """One image (H, W, C) as stream words, lane 0 and channel 0 lowest."""
    octets = frame.reshape(-1, lanes * frame.shape[-1])
    return [int.from_bytes(beat.tobytes(), "little") for beat in octets]


class Sink:
    """Takes an AXI4-Stream at every clock and keeps words, markers and the clock of each transfer."""

    def __init__(self, dut, prefix: str, octets: int):
        self.octets, self.data, self.last, self.user, self.at = octets, bytearray(), [], [], []
        self.ports = {
            k: getattr(dut, f"{prefix}_{k}") for k in ("tdata", "tvalid", "tready", "tlast", "tuser")
        }
        self.ports["tready"].value = 1

    def sample(self, cycle: int) -> None:
        if int(self.ports["tvalid"].value) and int(self.ports["tready"].value):
            self.data += int(self.ports["tdata"].value).to_bytes(self.octets, "little")
            self.last.append(int(self.ports["tlast"].value))
            self.user.append(int(self.ports["tuser"].value))
            self.at.append(cycle)

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        return {
            f"{name}_words": np.frombuffer(bytes(self.data), dtype="<i4"),
            f"{name}_last": np.array(self.last, np.int8),
            f"{name}_user": np.array(self.user, np.int8),
            f"{name}_at": np.array(self.at, np.int64),
        }


@cocotb.test(timeout_time=SET["timeout_cycles"] * 10, timeout_unit="ns")
async def frames_back_to_back(dut):
    frames = np.load(FOLDER / "frames.npy", allow_pickle=False)
    lanes, width = SET["lanes"], frames.shape[2]
    line_beats = width // lanes
    words = [word for frame in frames for word in frame_words(frame, lanes)]
    frame_beats = len(words) // len(frames)

    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for name in ("tdata", "tvalid", "tlast", "tuser"):
        getattr(dut, f"s_axis_{name}").value = 0
    master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axil"), dut.clk, dut.rst)
    sinks = {}
    if SET["depth"]:
        sinks["depth"] = Sink(dut, "m_axis_depth", WORD // 8 * lanes)
    if SET["normals"]:
        sinks["normals"] = Sink(dut, "m_axis_normals", 3 * WORD // 8 * lanes)
    for _ in range(3):
        await RisingEdge(dut.clk)
    dut.rst.value = 0
    await RisingEdge(dut.clk)
    status = await write(master, ADDRESS["CONTROL"], 0b1001)
    assert status == 0, "CONTROL: write refused"
    identity = [(await read(master, ADDRESS[n]))[0] for n in ("ID", "BUNDLE_HASH_LOW", "BUNDLE_HASH_HIGH")]
    assert identity == [0x46544143, *SET["bundle_hash"]], f"identity {identity}: not that of the bundle"

    results, registers = [], []

    async def host() -> None:
        """What a driver does: wait for the interrupt, read the force and the counters, acknowledge."""
        while len(results) < len(frames):
            if not int(dut.interrupt.value):
                await RisingEdge(dut.interrupt)
            force = []
            for axis in SET["axes"]:
                low = (await read(master, ADDRESS[f"FORCE_{axis.upper()}_LOW"]))[0]
                high = (await read(master, ADDRESS[f"FORCE_{axis.upper()}_HIGH"]))[0]
                value = high << 32 | low
                force.append(value - (1 << 64) if value >> 63 else value)
            results.append(force)
            registers.append({n: (await read(master, ADDRESS[n]))[0] for n in SET["registers"]})
            await write(master, ADDRESS["INTERRUPT_STATUS"], 1)

    host_task = cocotb.start_soon(host())
    sent, cycle, first_at, interrupt_at = 0, 0, [], []
    offered = -1
    before = 0
    while len(results) < len(frames) or any(
        len(sink.data) < SET["octets"][name] for name, sink in sinks.items()
    ):
        if offered != sent and sent < len(words):
            dut.s_axis_tdata.value = words[sent]
            dut.s_axis_tvalid.value = 1
            dut.s_axis_tuser.value = int(sent % frame_beats == 0)
            dut.s_axis_tlast.value = int(sent % line_beats == line_beats - 1)
            offered = sent
        elif sent == len(words):
            dut.s_axis_tvalid.value = 0
        await ReadOnly()
        taken = sent < len(words) and int(dut.s_axis_tready.value)
        for sink in sinks.values():
            sink.sample(cycle)
        level = int(dut.interrupt.value)
        if level and not before:
            interrupt_at.append(cycle)
        before = level
        await RisingEdge(dut.clk)
        if taken:
            if sent % frame_beats == 0:
                first_at.append(cycle)
            sent += 1
        cycle += 1
        if cycle % 1000 == 0:
            (FOLDER / "cycle").write_text(str(cycle))
    await host_task
    errors = (await read(master, ADDRESS["ERRORS"]))[0]
    count = (await read(master, ADDRESS["FRAME_COUNT"]))[0]
    outputs = {
        "first_at": np.array(first_at, np.int64),
        "interrupt_at": np.array(interrupt_at, np.int64),
        "force_raw": np.array(results, np.int64),
    }
    for name, sink in sinks.items():
        outputs |= sink.arrays(name)
    np.savez(FOLDER / "outputs.npz", **outputs)
    (FOLDER / "registers.json").write_text(
        json.dumps({"frames": registers, "errors": errors, "frame_count": count, "cycles": cycle})
    )
