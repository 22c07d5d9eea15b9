"""Boards without hardware: the core model and DMAs behind files as of UIO and u-dma-buf, or as PYNQ's parts.

Files that are mapped cannot tell a read, nor a write of the value that is there already. So registers where
that matters read as marked in bit 31, which neither ERRORS, INTERRUPT_STATUS, DMASR nor LENGTH has; and what
takes side effects of reads (the results' FIFO) or equal writes (calibrations) is not played.
"""

import contextlib
import mmap
import os
import socket
import struct
import threading
import time
from collections import deque
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.core_model import CoreModel
from fastac.driver.transports.dma_transport import buffer_bytes
from fastac.driver.transports.uio import UioDevice
from fastac.gateware.target.block_design import family_of
from fastac.models.integer.bundle import Bundle
from fastac.sim.dma.axi_dma import ADDRESS, ADDRESS_MSB, DMACR, DMASR, LENGTH, MM2S, S2MM
from fastac.sim.dma.packet_dma import Memory, PacketDma

MARK = 1 << 31
ADDRESS_OF_BUFFER = 0x7000_0000


class Board:
    """The core model with its DMAs and memory: `step` moves what can be moved."""

    def __init__(self, bundle: Bundle, description: Description, octets, calibrations=()):
        self.model, self.description = CoreModel(bundle, description, calibrations), description
        self.dmas = [
            PacketDma(Memory(ADDRESS_OF_BUFFER, octets), lambda: None) for _ in description.streams_out
        ]
        self.waiting = {name: deque() for name in description.streams_out}

    def step(self) -> None:
        frame = self.dmas[0].frame()
        if frame is not None:
            for name, packets in self.model.accept([np.frombuffer(frame, np.uint8)]).items():
                self.waiting[name].extend(packets)
            self.dmas[0].sent()
        for dma, packets in zip(self.dmas, self.waiting.values(), strict=True):
            while packets and dma.wants is not None:
                dma.deliver(packets.popleft().tobytes())


class UioBoard:
    """A board in a folder: `sys` and `dev` in place of /sys/class and /dev, played by a thread.

    dma : the name of every DMA's UIO device, as where only its address tells which one it is
    looks : how often the thread has begun to look at the registers
    """

    def __init__(self, bundle: Bundle, description: Description, folder: Path, dma: str = "dma"):
        self.sys, self.dev = folder / "sys", folder / "dev"
        self.dev.mkdir(parents=True)
        family = family_of(description.part)
        count = len(description.streams_out)
        self.files, self.words = [], []
        ends = [socket.socketpair() for _ in range(count + 1)]
        self._host_ends = {self.dev / f"uio{k}": host for k, (host, _) in enumerate(ends)}
        self._ends = [own for _, own in ends]
        names = ["fastac_0", *(dma for _ in range(count))]
        addresses = [family.core_address, *map(family.dma_at, range(count))]
        for k, (name, address) in enumerate(zip(names, addresses, strict=True)):
            maps = self.sys / "uio" / f"uio{k}" / "maps" / "map0"
            maps.mkdir(parents=True)
            (maps.parent.parent / "name").write_text(f"{name}\n")
            (maps / "addr").write_text(f"{address:#x}\n")
            (maps / "size").write_text("0x1000\n")
            self.words.append(self._map(self.dev / f"uio{k}", 4096).cast("I"))
        size = buffer_bytes(description)
        place = self.sys / "u-dma-buf" / "udmabuf0"
        place.mkdir(parents=True)
        (place / "phys_addr").write_text(f"{ADDRESS_OF_BUFFER:#x}\n")
        (place / "size").write_text(f"{size}\n")
        self.board = Board(bundle, description, self._mmap(self.dev / "udmabuf0", size))
        self._core = [r for r in description.registers if r.access != "wo" and r.name != "RESULTS_WORD"]
        self._shadow: list[dict[int, int]] = [{} for _ in self.words]
        self._enabled = [False] * len(self.words)
        self._refresh()
        self._stop, self.looks = threading.Event(), 0
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def _mmap(self, path: Path, size: int) -> mmap.mmap:
        path.write_bytes(bytes(size))
        with open(path, "r+b") as file:
            found = mmap.mmap(file.fileno(), size)
        self.files.append(found)
        return found

    def _map(self, path: Path, size: int) -> memoryview:
        return memoryview(self._mmap(path, size))

    def device(self, number: int, sys: Path, dev: Path) -> UioDevice:
        """A UIO device of this board."""
        board = self

        class Device(UioDevice):
            """Interrupts come through a socket; and, as on a bus, what is read after a write is later."""

            def open_interrupt(self, path: Path) -> int:
                return os.dup(board._host_ends[path].fileno())

            def write(self, offset: int, value: int) -> None:
                super().write(offset, value)
                seen = board.looks + 2  # the look that is under way may have passed this register
                while board.looks < seen:
                    time.sleep(0.0001)

        return Device(number, sys, dev)

    def _play(self) -> None:
        while not self._stop.wait(0.0001):
            self.looks += 1
            self._take_writes()
            self.board.step()
            self._refresh()
            self._interrupts()

    def _take_writes(self) -> None:
        """Whatever differs from what was put there has been written by the host."""
        for k, (words, shadow) in enumerate(zip(self.words, self._shadow, strict=True)):
            # A length is written last: where it is new, what is read after it is new, too.
            order = sorted(shadow, key=lambda offset: (k == 0 or offset % S2MM != LENGTH, offset))
            seen = {offset: words[offset >> 2] for offset in order}
            for offset in reversed(order):
                value = seen[offset]
                if value == shadow[offset]:
                    continue
                shadow[offset] = value
                if k == 0:
                    self.board.model.write(offset, value)
                else:
                    self.board.dmas[k - 1].write(offset, value)

    def _refresh(self) -> None:
        """Put the registers' values where they have changed."""
        model = self.board.model
        for facts in self._core:
            high = facts.name.startswith(("FORCE_", "TIME_")) and facts.name.endswith("_HIGH")
            if high and facts.name.startswith("FORCE_"):
                value = int(model.last[facts.name.removesuffix("_HIGH").lower()]) >> 32 & 0xFFFFFFFF
            else:
                value = 0 if high else model.read(facts.offset)
            self._put(0, facts.offset, value | MARK if facts.access == "w1c" else value)
        for k, dma in enumerate(self.board.dmas):
            for base in (MM2S, S2MM):
                for register in (DMACR, ADDRESS, ADDRESS_MSB):
                    self._put(k + 1, base + register, dma.read(base + register))
                for register in (DMASR, LENGTH):
                    self._put(k + 1, base + register, dma.read(base + register) | MARK)

    def _put(self, k: int, offset: int, value: int) -> None:
        shadow, words = self._shadow[k], self.words[k]
        if shadow.get(offset) != value and words[offset >> 2] == shadow.get(offset, 0):
            words[offset >> 2] = shadow[offset] = value

    def _interrupts(self) -> None:
        """Each device interrupts once after it was enabled, while its line is high. A DMA with two directions
        has the interrupt of the first one, as UIO takes no second."""
        model = self.board.model
        levels = [model.pending and model.interrupt_enable, self.board.dmas[0].mm2s.interrupt]
        levels += [dma.s2mm.interrupt for dma in self.board.dmas[1:]]
        for k, (end, level) in enumerate(zip(self._ends, levels, strict=True)):
            end.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                self._enabled[k] |= bool(end.recv(4))
            if self._enabled[k] and level:
                self._enabled[k] = False
                end.send(struct.pack("<I", 1))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for words in self.words:
            words.release()
        for end in (*self._ends, *self._host_ends.values()):
            end.close()


class _Part:
    """A part of an overlay: registers, after each access to which the board moves on."""

    def __init__(self, board: Board, registers):
        self._board, self._registers = board, registers

    def read(self, offset: int) -> int:
        return self._registers.read(offset)

    def write(self, offset: int, value: int) -> None:
        self._registers.write(offset, value)
        self._board.step()


class _Allocated(np.ndarray):
    """What pynq.allocate gives."""

    device_address = ADDRESS_OF_BUFFER

    def flush(self) -> None: ...

    def invalidate(self) -> None: ...

    def freebuffer(self) -> None: ...


def pynq_module(bundle: Bundle, description: Description, calibrations=()) -> ModuleType:
    """A module to be put into sys.modules as `pynq`."""
    octets = bytearray(buffer_bytes(description))
    board = Board(bundle, description, octets, calibrations)
    parts = {f"axi_dma_{k}": _Part(board, dma) for k, dma in enumerate(board.dmas)}
    module = ModuleType("pynq")
    module.board = board
    module.Overlay = lambda path: SimpleNamespace(fastac_0=_Part(board, board.model), **parts)
    module.allocate = lambda shape, kind: np.frombuffer(octets, kind)[: shape[0]].view(_Allocated)
    return module
