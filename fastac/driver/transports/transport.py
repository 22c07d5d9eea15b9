"""What a transport is: how a driver reaches the hardware, whatever the hardware is."""

from collections.abc import Callable
from typing import Protocol

import numpy as np


class TransportError(RuntimeError):
    """The hardware did not answer as it should; the message is one line."""


class TransportTimeout(TransportError):
    """A packet did not come in time."""


class DmaError(TransportError):
    """A DMA reported errors."""


class PacketSizeError(DmaError):
    """A packet is not as long as it should be, as the rest of one that a reset has cut."""


class ClosedError(TransportError):
    """The other side is gone: nothing more will come."""


class Transport(Protocol):
    """Access to one core: its registers, its frames and its packets. Safe to use from several threads.

    frames_in_flight : how many frames may be sent before the packets of the first one are taken
    """

    frames_in_flight: int

    def read(self, offset: int) -> int:
        """The 32-bit register at the byte address `offset`."""

    def write(self, offset: int, value: int) -> None:
        """Write the 32-bit register at the byte address `offset`."""

    def send(self, frame: np.ndarray) -> None:
        """Begin to send a frame, uint8, as it lies in memory (`FrameFormat`)."""

    def receive(self, stream: str, timeout_s: float) -> np.ndarray:
        """The next packet of an output stream, uint8, or of the stream "results".

        Raises TransportTimeout where none came in time, and DmaError.
        """

    def sent(self, timeout_s: float) -> bool:
        """Whether the hardware has taken every frame that was sent; waits for it."""

    def wait_interrupt(self, timeout_s: float) -> bool:
        """Wait for the core's interrupt; whether it came. It is cleared in the core then."""

    def reset_dma(self) -> None:
        """Abandon all transfers and be ready for new ones."""

    def now_s(self) -> float:
        """Time in s, from any start, by which timeouts pass."""

    def close(self) -> None:
        """Release everything; may be called more than once."""


def until(done: Callable[[], bool], transport, timeout_s: float, pause: Callable[[float], object]) -> bool:
    """Whether `done()` became true within `timeout_s` by the transport's time; `pause(s)` lets it pass."""
    end = transport.now_s() + timeout_s
    while not done():
        left = end - transport.now_s()
        if left <= 0:
            return False
        pause(left)
    return True
