"""Linux without a kernel module of our own: a `Transport` through UIO devices and u-dma-buf.

The core and each DMA are UIO devices (driver uio_pdrv_genirq, `compatible = "generic-uio"`): their registers
are mapped from /dev/uioN, and their interrupts are enabled by writing 1 and awaited by reading 4 bytes there
(kernel documentation, "The Userspace I/O HOWTO"). The buffer is /dev/udmabuf0 of the module u-dma-buf, whose
physical address and cache maintenance are files in /sys/class/u-dma-buf.

Devices are found by their names in /sys/class/uio, or by the addresses that the block design gives them. Of
the two interrupts of axi_dma_0 UIO takes one only; nothing depends on which, as the core's tells of results.
This has been tested against a stand-in of these files, never on a board.
"""

import contextlib
import mmap
import os
import select
import struct
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.dma_transport import DmaTransport, buffer_bytes
from fastac.driver.transports.transport import TransportError
from fastac.gateware.target.block_design import CORE, dma_instance, family_of

ENABLE = struct.pack("<I", 1)
TO_DEVICE, FROM_DEVICE = 1, 2
"""Directions of u-dma-buf's cache maintenance, `sync_direction`."""
POLL_S = 0.5e-3
"""Longest wait for an interrupt before the DMAs are looked at: the core tells of a result before the last
beats of its packet are in memory."""
SPIN_S = 50e-6
"""After an interrupt the DMAs are looked at without waiting for so long."""


def open_device(path: Path) -> int:
    """A file descriptor for reading and writing."""
    return os.open(path, os.O_RDWR | os.O_SYNC | os.O_CLOEXEC)


class UioDevice:
    """Registers and interrupt of one UIO device.

    number : N of /dev/uioN; sys, dev : folders in place of /sys/class/uio and /dev
    """

    def __init__(self, number: int, sys: Path, dev: Path):
        path = dev / f"uio{number}"
        size = _number(sys / f"uio{number}" / "maps" / "map0" / "size")
        try:
            handle = open_device(path)
            try:
                self._map = mmap.mmap(handle, size, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE)
            finally:
                os.close(handle)
            self.interrupt = self.open_interrupt(path)
        except OSError as error:
            raise TransportError(f"{path}: {error.strerror}; may this user open it?") from None
        # One access of 32 bits for each element: a slice of the map would be copied in bytes.
        self._words = memoryview(self._map).cast("I")
        self.enabled = False

    def open_interrupt(self, path: Path) -> int:
        """What interrupts are read from and enabled by."""
        return open_device(path)

    def read(self, offset: int) -> int:
        return self._words[offset >> 2]

    def write(self, offset: int, value: int) -> None:
        self._words[offset >> 2] = value

    def enable(self) -> None:
        """Let the next interrupt come; the kernel disables it when it has."""
        if not self.enabled:
            os.write(self.interrupt, ENABLE)
            self.enabled = True

    def taken(self) -> None:
        """The interrupt is there: take it."""
        os.read(self.interrupt, 4)
        self.enabled = False

    def close(self) -> None:
        self._words.release()
        self._map.close()
        os.close(self.interrupt)


class DmaBuffer:
    """The buffer of u-dma-buf: mapped memory, its physical address, and cache maintenance."""

    def __init__(self, name: str, sys: Path, dev: Path):
        self._sys = sys / name
        self.address, self.size = _number(self._sys / "phys_addr"), _number(self._sys / "size")
        try:
            handle = os.open(dev / name, os.O_RDWR | os.O_CLOEXEC)
            try:
                self._map = mmap.mmap(handle, self.size, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE)
            finally:
                os.close(handle)
        except OSError as error:
            raise TransportError(f"{dev / name}: {error.strerror}") from None
        self._octets = np.frombuffer(self._map, np.uint8)

    def _sync(self, offset: int, count: int, direction: int, file: str) -> None:
        for name, value in (("sync_offset", offset), ("sync_size", count), ("sync_direction", direction)):
            (self._sys / name).write_text(str(value))
        (self._sys / file).write_text("1")

    def write(self, offset: int, octets: np.ndarray) -> None:
        self._sync(offset, octets.size, TO_DEVICE, "sync_for_cpu")
        self._octets[offset : offset + octets.size] = octets
        self._sync(offset, octets.size, TO_DEVICE, "sync_for_device")

    def read(self, offset: int, count: int) -> np.ndarray:
        self._sync(offset, count, FROM_DEVICE, "sync_for_cpu")
        found = self._octets[offset : offset + count].copy()
        self._sync(offset, count, FROM_DEVICE, "sync_for_device")
        return found

    def close(self) -> None:
        del self._octets
        self._map.close()


class UioTransport(DmaTransport):
    """A `Transport` to a core on this machine.

    buffer : name of the u-dma-buf
    sys, dev, device : folders in place of /sys/class and /dev, and a class in place of `UioDevice`, for tests
    Raises TransportError, which names the file, where a device is missing or must not be opened.
    """

    def __init__(
        self,
        description: Description,
        *,
        buffer: str = "udmabuf0",
        sys: Path = Path("/sys/class"),
        dev: Path = Path("/dev"),
        device: Callable[[int, Path, Path], UioDevice] = UioDevice,
    ):
        family = family_of(description.part)
        wanted = [(CORE, family.core_address)]
        wanted += [(dma_instance(k), family.dma_at(k)) for k in range(len(description.streams_out))]
        with contextlib.ExitStack() as opened:
            self._devices = []
            for number in find(wanted, sys / "uio"):
                self._devices.append(device(number, sys / "uio", dev))
                opened.callback(self._devices[-1].close)
            memory = DmaBuffer(buffer, sys / "u-dma-buf", dev)
            opened.callback(memory.close)
            if memory.size < buffer_bytes(description):
                raise TransportError(
                    f"{dev / buffer}: {memory.size} bytes: expected {buffer_bytes(description)} or more;"
                    " load u-dma-buf with a larger size"
                )
            self._by_interrupt = {device.interrupt: device for device in self._devices}
            self._spin_until = 0.0
            super().__init__(description, self._devices[0], self._devices[1:], memory, wide=True)
            self._opened = opened.pop_all()

    def now_s(self) -> float:
        return time.monotonic()

    def wait_interrupt(self, timeout_s: float) -> bool:
        if time.monotonic() < self._spin_until:
            return False
        for device in self._devices:
            device.enable()
        waited = select.poll()
        for handle in self._by_interrupt:
            waited.register(handle, select.POLLIN)
        core = False
        for handle, _ in waited.poll(1e3 * min(timeout_s, POLL_S)):
            device = self._by_interrupt[handle]
            device.taken()
            self._spin_until = time.monotonic() + SPIN_S
            if device is self._devices[0]:
                core = True
                self.clear_interrupt()
        return core

    def close(self) -> None:
        self._opened.close()


def find(wanted: Sequence[tuple[str, int]], sys: Path) -> list[int]:
    """The numbers of the UIO devices of these (name, physical address), in their order.

    A device is taken whose name it is, as the device tree or `linux,uio-name` gives it; else the one at the
    address. Raises TransportError for one that is not there, naming those that are.
    """
    found = {}
    for entry in sorted(sys.glob("uio*")):
        name, address = (entry / "name").read_text().strip(), _number(entry / "maps" / "map0" / "addr")
        found[int(entry.name.removeprefix("uio"))] = (name, address)
    numbers = []
    for name, address in wanted:
        same = [n for n, (has, _) in found.items() if has == name]
        same = same or [n for n, (_, at) in found.items() if at == address]
        if not same:
            there = ", ".join(f"{has} at {at:#x}" for has, at in found.values()) or "none"
            raise TransportError(f"{sys}: no device {name} or at {address:#x}; there are: {there}")
        numbers.append(same[0])
    return numbers


def _number(path: Path) -> int:
    """The number in a file of /sys, decimal or hexadecimal."""
    try:
        return int(path.read_text().strip(), 0)
    except OSError as error:
        raise TransportError(f"{path}: {error.strerror}") from None
    except ValueError:
        raise TransportError(f"{path}: no number") from None
