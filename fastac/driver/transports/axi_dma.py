"""One direction of an AXI DMA without scatter-gather: how its registers are written and what they say.

After AMD's product guide PG021 (AXI DMA v7.1): "Register Space" for offsets and bits, "Direct Register Mode
(Simple DMA)" for the order of accesses. The DMA holds one transfer at a time.
"""

import time
from typing import Protocol

from fastac.driver.transports.transport import DmaError

MM2S, S2MM = 0x00, 0x30
"""Where the registers of the direction to the stream and of the direction from it begin."""
DMACR, DMASR, ADDRESS, ADDRESS_MSB, LENGTH = 0x00, 0x04, 0x18, 0x1C, 0x28
"""Control, status, source or destination address, its bits 63:32, and bytes; from the direction's start."""
RUN, RESET, IOC_ENABLE, ERROR_ENABLE = 1 << 0, 1 << 2, 1 << 12, 1 << 14
"""Bits of DMACR."""
HALTED, IDLE, IOC, ERROR_IRQ = 1 << 0, 1 << 1, 1 << 12, 1 << 14
"""Bits of DMASR. IOC: the transfer is complete. Write 1 to clear IOC and ERROR_IRQ."""
ERRORS = {4: "internal", 5: "slave", 6: "decode"}
"""Bits of DMASR that report errors without scatter-gather: the length was 0 or the packet is longer than the
transfer; the memory answered SLVERR; nothing is at the address. Only a reset ends them."""
LENGTH_MASK = (1 << 26) - 1
WAIT_S = 0.5
"""Wall-clock time after which a reset or a start counts as failed: both take a few clocks."""


class Window(Protocol):
    """32-bit registers at byte offsets."""

    def read(self, offset: int) -> int: ...

    def write(self, offset: int, value: int) -> None: ...


class Channel:
    """One direction of a DMA, `name` in messages.

    wide : the DMA has addresses of more than 32 bits, so that ADDRESS_MSB exists
    """

    def __init__(self, window: Window, base: int, name: str, *, wide: bool):
        self._window, self._base, self.name, self._wide = window, base, name, wide
        self.busy = False
        """A transfer has been begun and has not been seen to end."""

    def _read(self, register: int) -> int:
        return self._window.read(self._base + register)

    def _write(self, register: int, value: int) -> None:
        self._window.write(self._base + register, value)

    def reset(self) -> None:
        """Reset the whole DMA, its other direction included (PG021: either direction's bit resets both)."""
        self._write(DMACR, RESET)
        end = time.monotonic() + WAIT_S
        while self._read(DMACR) & RESET:
            if time.monotonic() > end:
                raise DmaError(f"{self.name}: the reset does not end; is its clock running?")
        self.busy = False

    def start(self) -> None:
        """Let the channel run, with interrupts at the end of a transfer and on errors."""
        self._write(DMACR, RUN | IOC_ENABLE | ERROR_ENABLE)
        end = time.monotonic() + WAIT_S
        while (status := self._read(DMASR)) & HALTED:
            self._check(status)
            if time.monotonic() > end:
                raise DmaError(f"{self.name}: stays halted, DMASR = {status:#010x}")

    def transfer(self, address: int, length: int) -> None:
        """Begin to move `length` bytes from or to the physical `address`; LENGTH begins it, so it is last."""
        self._write(ADDRESS, address & 0xFFFFFFFF)
        if self._wide:
            self._write(ADDRESS_MSB, address >> 32)
        self.busy = True
        self._write(LENGTH, length)

    def done(self) -> bool:
        """Whether the transfer is complete; its interrupt is cleared then. Raises DmaError on errors."""
        status = self._read(DMASR)
        self._check(status)
        if not status & IOC:
            return False
        self._write(DMASR, IOC)
        self.busy = False
        return True

    def moved(self) -> int:
        """Bytes that the last transfer from the stream has written to memory."""
        return self._read(LENGTH) & LENGTH_MASK

    def _check(self, status: int) -> None:
        """Raise DmaError if a status has errors, by their names."""
        names = [name for bit, name in ERRORS.items() if status >> bit & 1]
        if names:
            raise DmaError(f"{self.name}: DMA error: {', '.join(names)} (DMASR = {status:#010x})")
