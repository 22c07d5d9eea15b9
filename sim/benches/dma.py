"""cocotb testbench of the top level with packets between models of AXI DMA, in front of a memory.

Settings and frames are in the folder BENCH, as for top.py; tests/sim/dma/test_memory.py makes them
and reads what is written to KIND_STALL.npz. Frames come from a camera or from memory through MM2S, images go
to memory through S2MM.
"""

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge
from cocotbext.axi import AxiLiteBus, AxiLiteMaster
from cocotbext.axi.memory import Memory

from fastac.sim.benches.top import FOLDER, SETTINGS, Host, frame_words
from fastac.sim.dma.axi_dma import (
    ADDRESS,
    DMACR,
    DMASR,
    ERROR_ENABLE,
    IOC,
    IOC_ENABLE,
    LENGTH,
    MM2S,
    RUN,
    S2MM,
    AxiDma,
    Beat,
    Timing,
)
from fastac.sim.dma.ports import InputPort, OutputPort

TEST = {"timeout_time": SETTINGS["timeout_cycles"] * SETTINGS["period_ps"], "timeout_unit": "ps"}
FRAMES = np.load(FOLDER / "frames.npy", allow_pickle=False)
ENABLE, INTERRUPT = 1, 8


class Camera:
    """Sends frames as fast as they are taken, with the members of `Mm2s` that `System` needs."""

    def __init__(self, octets: int):
        full, lanes = (1 << octets) - 1, SETTINGS["lanes"]
        words = [frame_words(frame, lanes) for frame in FRAMES]
        self.frames = [
            [Beat(w.to_bytes(octets, "little"), full, k == len(frame) - 1) for k, w in enumerate(frame)]
            for frame in words
        ]
        self.queue: list[Beat] = []

    def send(self, count: int) -> None:
        """Frames of the bank, one after the other, `count` in all."""
        self.queue = [beat for k in range(count) for beat in self.frames[k % len(self.frames)]][::-1]

    def offer(self) -> Beat | None:
        return self.queue[-1] if self.queue else None

    def clock(self, taken: bool) -> None:
        if taken:
            self.queue.pop()


class System:
    """The core with a source of frames and a DMA for each output, and what the ports and interrupts did.

    first_at, last_at : clock of the acceptance of each frame's first and last beat
    done_at : {output: clock in which each packet's interrupt of S2MM rose}
    """

    def __init__(self, dut, source, dmas: dict[str, AxiDma]):
        self.dut, self.source, self.dmas, self.cycle = dut, source, dmas, 0
        self.first_at, self.last_at = [], []
        self.done_at = {name: [] for name in dmas}
        self.result_at: list[int] = []
        self.input = InputPort(dut)
        self.ports = {name: OutputPort(dut, name, dma.s2mm.octets) for name, dma in dmas.items()}

    async def run(self) -> None:
        dut, inside, levels, result = self.dut, False, dict.fromkeys(self.dmas, False), 0
        while True:
            offer = self.source.offer()
            self.input.offer(offer)
            for name, dma in self.dmas.items():
                self.ports[name].open(dma.s2mm.ready)
            await ReadOnly()
            taken = self.input.taken()
            if taken and not inside:
                self.first_at.append(self.cycle)
            if taken and offer.last:
                self.last_at.append(self.cycle)
            inside = not offer.last if taken else inside
            self.source.clock(taken)
            for name, dma in self.dmas.items():
                dma.s2mm.clock(self.ports[name].beat())
                level = dma.s2mm.interrupt
                if level and not levels[name]:
                    self.done_at[name].append(self.cycle + 1)
                levels[name] = level
            before, result = result, int(dut.interrupt.value)
            if result and not before:
                self.result_at.append(self.cycle)
            await RisingEdge(dut.clk)
            self.cycle += 1


async def start(dut, timing: Timing, *, from_memory: bool) -> tuple[System, Host, Memory]:
    Clock(dut.clk, SETTINGS["period_ps"], unit="ps").start()
    dut.rst.value = 1
    memory, octets = Memory(1 << 26), len(dut.s_axis_tkeep)
    dmas = {
        name: AxiDma(
            memory, s2mm_bits=8 * size, mm2s_bits=8 * octets * (k == 0 and from_memory), timing=timing, seed=k
        )
        for k, (name, size) in enumerate(SETTINGS["outputs"].items())
    }
    for dma in dmas.values():
        dma.write(S2MM + DMACR, RUN | IOC_ENABLE | ERROR_ENABLE)
    source = next(iter(dmas.values())).mm2s if from_memory else Camera(octets)
    system = System(dut, source, dmas)
    host = Host(dut, AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axil"), dut.clk, dut.rst))
    await ClockCycles(dut.clk, 3)
    dut.rst.value = 0
    await RisingEdge(dut.clk)
    await host.write("CONTROL", ENABLE | INTERRUPT)
    return system, host, memory


async def receive(system: System, name: str, place: int, count: int) -> None:
    """Take `count` packets of an output, one transfer each; the next begins `host_clocks` after an
    interrupt."""
    dma, size = system.dmas[name], SETTINGS["packet_bytes"][name]
    for k in range(count):
        dma.write(S2MM + ADDRESS, place + k * size)
        dma.write(S2MM + LENGTH, size)
        while not dma.s2mm.interrupt:
            await RisingEdge(system.dut.clk)
        dma.write(S2MM + DMASR, IOC)
        assert dma.read(S2MM + LENGTH) == size, f"{name}: packet {k}"
        await ClockCycles(system.dut.clk, SETTINGS["host_clocks"])


async def send(system: System, memory: Memory, count: int) -> None:
    """Frames from memory, one transfer each."""
    dma = next(iter(system.dmas.values()))
    words = [frame_words(frame, SETTINGS["lanes"]) for frame in FRAMES]
    octets = dma.mm2s.octets
    bank = [b"".join(word.to_bytes(octets, "little") for word in frame) for frame in words]
    for k, frame in enumerate(bank):
        memory.write(k * len(frame), frame)
    dma.write(MM2S + DMACR, RUN | IOC_ENABLE)
    for k in range(count):
        dma.write(MM2S + ADDRESS, k % len(bank) * len(bank[0]))
        dma.write(MM2S + LENGTH, len(bank[0]))
        while not dma.mm2s.interrupt:
            await RisingEdge(system.dut.clk)
        dma.write(MM2S + DMASR, IOC)
        await ClockCycles(system.dut.clk, SETTINGS["host_clocks"])


async def through_memory(dut, count: int, timing: Timing, *, from_memory: bool) -> None:
    """`count` frames into the core, and all packets into memory; writes what lies there to KIND_STALL.npz."""
    system, _, memory = await start(dut, timing, from_memory=from_memory)
    names, places = list(system.dmas), {}
    for k, name in enumerate(names):
        places[name] = (1 << 24) * (k + 1)
    cocotb.start_soon(system.run())
    if from_memory:
        cocotb.start_soon(send(system, memory, count))
    else:
        system.source.send(count)
    for task in [cocotb.start_soon(receive(system, name, places[name], count)) for name in names]:
        await task
    await ClockCycles(dut.clk, SETTINGS["linger_cycles"])
    found = {
        f"{name}_words": np.frombuffer(
            bytes(memory.read(places[name], count * SETTINGS["packet_bytes"][name])), "<i4"
        )
        for name in names
    }
    found |= {f"{name}_done_at": np.array(system.done_at[name]) for name in names}
    kind = "memory" if from_memory else "camera"
    np.savez(
        FOLDER / f"{kind}_{round(100 * timing.stall)}.npz",
        first_at=system.first_at,
        last_at=system.last_at,
        **found,
    )


@cocotb.test(**TEST)
async def camera_to_memory(dut):
    await through_memory(dut, SETTINGS["count"], Timing(write=SETTINGS["write_clocks"]), from_memory=False)


@cocotb.test(**TEST)
async def memory_to_memory(dut):
    await through_memory(dut, SETTINGS["count"], Timing(write=SETTINGS["write_clocks"]), from_memory=True)


@cocotb.test(**TEST)
async def memory_that_stalls(dut):
    await through_memory(dut, SETTINGS["few"], Timing(stall=0.3), from_memory=True)


@cocotb.test(**TEST)
async def through_the_registers(dut):
    """A host that waits for the interrupt and reads the force, or the record, as fast as the bus gives
    them."""
    system, host, _ = await start(dut, Timing(), from_memory=False)
    cocotb.start_soon(system.run())
    for dma in system.dmas.values():
        dma.s2mm.write(ADDRESS, 0)
        dma.s2mm.write(LENGTH, 1 << 20)
    taken = {}
    for name in ("force", "record"):
        system.source.send(1)
        await RisingEdge(dut.interrupt)
        if name == "force":
            taken["force"] = await host.force()
        else:
            taken["record"] = [await host.read("RESULTS_WORD") for _ in range(SETTINGS["record_words"])]
        taken[f"{name}_at"] = system.cycle
        await host.write("INTERRUPT_STATUS", 1)
        if name == "force":
            for _ in range(SETTINGS["record_words"]):
                await host.read("RESULTS_WORD")
        for dma in system.dmas.values():
            while not dma.s2mm.interrupt:
                await RisingEdge(dut.clk)
            dma.s2mm.write(DMASR, IOC)
            dma.s2mm.write(LENGTH, 1 << 20)
    np.savez(FOLDER / "registers.npz", last_at=system.last_at, result_at=system.result_at, **taken)
