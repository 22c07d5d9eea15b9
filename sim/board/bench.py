"""cocotb bench that is a board: a host in another process drives the hardware through a socket.

Reads hardware.json (environment variable FASTAC_HARDWARE) and listens on FASTAC_SOCKET; sim/board/protocol.py
says what can be asked. Waiting for a request stops the simulation, so that a host that thinks costs no clock.
"""

import json
import logging
import os
import socket
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, Event, First, Lock, RisingEdge, Timer
from cocotb.utils import get_sim_time
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

from fastac.gateware.target.block_design import family_of
from fastac.sim.benches import host
from fastac.sim.board import protocol
from fastac.sim.board.packet_streams import PacketStreams
from fastac.sim.board.video_streams import VideoStreams
from fastac.sim.dma.axi_dma import DmaMisuse
from fastac.sim.dma.packet_dma import Memory

ACCEPT_S = 60
"""How long the board waits for its host."""
CONTROL_SOFT_RESET = 1 << 2
CORE_RANGE = 1 << 12


class Refused(Exception):
    """A request that cannot be carried out."""


class Board:
    """The hardware with its register bus, DMAs, memory and interrupt lines."""

    def __init__(self, dut, description: dict):
        self.dut, self.description = dut, description
        self.period_ps = 2 * round(0.5e6 / description["clock_mhz"])
        self.memory = Memory(protocol.MEMORY_ADDRESS, bytearray(protocol.MEMORY_BYTES))
        self.changed = Event()
        self.bus = Lock()
        self.offsets = {register["name"]: register["offset"] for register in description["registers"]}
        self.latched: dict[int, int] = {}
        outputs = [output["name"] for output in description["outputs"]] or ["results"]
        self.addresses = addresses(description, len(outputs))
        self.is_video = description["streams"] == "video"
        kind = VideoStreams if self.is_video else PacketStreams
        self.streams = kind(self, outputs)
        self.dmas = self.streams.dmas

    async def start(self) -> None:
        """Start the clock, reset the hardware, and let streams and interrupts be watched."""
        Clock(self.dut.clk, self.period_ps, unit="ps").start()
        self.dut.rst.value = 1
        bus = AxiLiteBus.from_prefix(self.dut, "s_axil")
        self.master = AxiLiteMaster(bus, self.dut.clk, self.dut.rst)
        for interface in (self.master.write_if, self.master.read_if):
            interface.log.setLevel(logging.WARNING)  # a line for each access takes longer than the access
        self.streams.connect(self.dut)
        await ClockCycles(self.dut.clk, 3)
        self.dut.rst.value = 0
        await RisingEdge(self.dut.clk)
        self.start_ps = get_sim_time("ps")
        self.streams.start()
        cocotb.start_soon(self._watch_interrupt())

    @property
    def cycle(self) -> int:
        """Clocks since reset."""
        return round((get_sim_time("ps") - self.start_ps) / self.period_ps)

    async def _watch_interrupt(self) -> None:
        while True:
            await RisingEdge(self.dut.interrupt)
            self.changed.set()

    @property
    def lines(self) -> int:
        """The interrupt lines. With video streams the core's serves the bench itself (video_streams.py)."""
        core = int(self.dut.interrupt.value) if not self.is_video else 0
        levels = self.streams.levels(core)
        return sum(level << line for line, level in enumerate(levels))

    async def run(self, clocks: int, mask: int) -> int:
        """Let clocks pass until a line of `mask` is high; returns the lines."""
        end = get_sim_time("ps") + min(clocks, protocol.MAX_CLOCKS) * self.period_ps
        while not self.lines & mask:
            left = end - get_sim_time("ps")
            if left <= 0:
                break
            self.changed.clear()
            await First(Timer(round(left), unit="ps"), self.changed.wait())
        return self.lines

    async def read_core(self, name: str) -> int:
        """A register by name, for the bench itself; take `bus` around what belongs together."""
        value, _ = await host.read(self.master, self.offsets[name])
        return value

    async def write_core(self, name: str, value: int) -> None:
        await host.write(self.master, self.offsets[name], value)

    def _place(self, address: int) -> tuple[object | None, int]:
        """The DMA at a physical address, None for the core, and the offset in its registers."""
        if self.addresses[0] <= address < self.addresses[0] + CORE_RANGE:
            return None, address - self.addresses[0]
        for dma, base in zip(self.dmas, self.addresses[1:], strict=True):
            if base <= address < base + CORE_RANGE:
                return dma, address - base
        raise Refused(f"address {address:#x}: nothing is there")

    async def read(self, address: int) -> int:
        dma, offset = self._place(address)
        if dma is not None:
            return dma.read(offset)
        if offset in self.latched:
            return self.latched.pop(offset)
        async with self.bus:
            value, response = await host.read(self.master, offset)
            if self.is_video and offset in self._halves and not response:
                # The bench reads these registers too, and would latch another upper half in between.
                self.latched[offset + 4], response = await host.read(self.master, offset + 4)
        if response:
            raise Refused(f"read at {address:#x}: response {response}")
        return value

    @property
    def _halves(self) -> set[int]:
        """Offsets of the registers whose read latches the next one."""
        return {
            offset for name, offset in self.offsets.items() if name.startswith("FORCE_") and "LOW" in name
        }

    async def write(self, address: int, value: int) -> None:
        dma, offset = self._place(address)
        if dma is not None:
            dma.write(offset, value)
            self.streams.wake()
            return
        control = offset == self.offsets["CONTROL"]
        if control:
            value = self.streams.control(value)
        async with self.bus:
            response = await host.write(self.master, offset, value)
        if response:
            raise Refused(f"write at {address:#x}: response {response}")
        if control and value & CONTROL_SOFT_RESET:
            await self.streams.after_soft_reset()


def addresses(description: dict, dmas: int) -> list[int]:
    """Where the core and the DMAs are, by the block design of the hardware's part."""
    family = family_of(description["part"])
    return [family.core_address, *map(family.dma_at, range(dmas))]


def received(connection: socket.socket, count: int) -> bytes | None:
    """That many bytes; None where the other side is gone."""
    data = bytearray()
    while len(data) < count:
        part = connection.recv(count - len(data))
        if not part:
            return None
        data += part
    return bytes(data)


async def answer(board: Board, connection: socket.socket, operation: int, argument: int, address: int):
    """Carry out one request; returns (value, bytes)."""
    if operation == protocol.READ:
        return await board.read(address), b""
    if operation == protocol.WRITE:
        await board.write(address, argument)
        return 0, b""
    if operation == protocol.MEMORY_READ:
        return 0, board.memory.read(address, argument)
    if operation == protocol.MEMORY_WRITE:
        board.memory.write(address, received(connection, argument) or b"")
        return 0, b""
    if operation == protocol.RUN:
        return await board.run(argument, address), b""
    raise Refused(f"operation {operation}: expected {protocol.READ} to {protocol.RUN}")


@cocotb.test()
async def serve(dut):
    """Serve one host until it goes."""
    board = Board(dut, json.loads(Path(os.environ["FASTAC_HARDWARE"]).read_text()))
    await board.start()
    path = os.environ["FASTAC_SOCKET"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.settimeout(ACCEPT_S)
        listener.bind(path)
        listener.listen(1)
        connection, _ = listener.accept()
    with connection:
        connection.settimeout(None)
        while (request := received(connection, protocol.REQUEST.size)) is not None:
            operation, argument, address = protocol.REQUEST.unpack(request)
            status = protocol.DONE
            try:
                value, payload = await answer(board, connection, operation, argument, address)
            except (Refused, DmaMisuse, ValueError) as error:
                status, value, payload = protocol.REFUSED, 0, str(error).encode()
            reply = protocol.REPLY.pack(status, len(payload), value, board.cycle)
            try:
                connection.sendall(reply + payload)
            except OSError:  # the host is gone
                return
