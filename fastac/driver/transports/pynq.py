"""A board with PYNQ: a `Transport` through an overlay's parts and a buffer of `pynq.allocate`.

Needs the package `pynq`, which is on a board's PYNQ image; it is imported when a transport is made. The DMAs
are driven by their registers as everywhere (axi_dma.py). Tested against a stand-in of PYNQ's interface, never
on a board.
"""

import time
from pathlib import Path

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.dma_transport import DmaTransport, buffer_bytes
from fastac.driver.transports.transport import TransportError
from fastac.gateware.target.block_design import CORE, dma_instance

POLL_S = 50e-6
"""Between two looks at the DMAs: PYNQ gives interrupts to asyncio programs only."""


class _Buffer:
    """Memory that the DMAs reach; caches are flushed and invalidated for all of it."""

    def __init__(self, buffer):
        self._buffer = buffer
        self.address, self.size = int(buffer.device_address), int(buffer.size)

    def write(self, offset: int, octets: np.ndarray) -> None:
        self._buffer[offset : offset + octets.size] = octets
        self._buffer.flush()

    def read(self, offset: int, count: int) -> np.ndarray:
        self._buffer.invalidate()
        return np.array(self._buffer[offset : offset + count])

    def close(self) -> None:
        self._buffer.freebuffer()


class PynqTransport(DmaTransport):
    """A `Transport` to the core `fastac_0` of an overlay, with its DMAs `axi_dma_0`, `axi_dma_1` and so on.

    bitstream : the .bit file, with its .hwh beside it; the programmable logic is loaded with it
    Raises TransportError where PYNQ is missing or the overlay has other parts.
    """

    def __init__(self, description: Description, bitstream: Path):
        try:
            import pynq
        except ImportError:
            raise TransportError("pynq: no such package; it is on the image of a PYNQ board") from None
        overlay = pynq.Overlay(str(bitstream))
        names = [CORE, *map(dma_instance, range(len(description.streams_out)))]
        try:
            core, *dmas = (getattr(overlay, name) for name in names)
        except AttributeError as error:
            raise TransportError(f"{bitstream}: the overlay lacks a part: {error}") from None
        self._memory = _Buffer(pynq.allocate((buffer_bytes(description),), np.uint8))
        super().__init__(description, core, dmas, self._memory, wide=True)

    def now_s(self) -> float:
        return time.monotonic()

    def wait_interrupt(self, timeout_s: float) -> bool:
        time.sleep(min(timeout_s, POLL_S))
        if not self.read(self.interrupt_status) & 1:
            return False
        self.clear_interrupt()
        return True

    def close(self) -> None:
        self._memory.close()
