"""The hardware without hardware: the emulator's integers behind the core's registers and packets."""

import threading
import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.core_model import CoreModel
from fastac.driver.transports.transport import TransportTimeout
from fastac.models.integer.bundle import Bundle

FRAMES_IN_FLIGHT = 6


class EmulatorTransport:
    """A `Transport` to `CoreModel`: frames are computed when their packets are asked for, all that wait at
    once, on all cores. Its time is the host's.

    calibrations : bundles whose calibration images may be loaded
    """

    frames_in_flight = FRAMES_IN_FLIGHT

    def __init__(
        self,
        bundle: Bundle,
        description: Description,
        *,
        calibrations: Sequence[Bundle] = (),
        frames_in_flight: int = FRAMES_IN_FLIGHT,
    ):
        self.frames_in_flight = frames_in_flight
        self.model = CoreModel(bundle, description, calibrations)
        self._lock = threading.RLock()
        self._waiting: deque[np.ndarray] = deque()
        self._packets: dict[str, deque[np.ndarray]] = {name: deque() for name in description.streams_out}

    def read(self, offset: int) -> int:
        with self._lock:
            self.model.in_flight = len(self._waiting)
            return self.model.read(offset)

    def write(self, offset: int, value: int) -> None:
        with self._lock:
            if self.model.concerns_frames(offset, value):
                self._compute()
            self.model.write(offset, value)

    def send(self, frame: np.ndarray) -> None:
        with self._lock:
            self._waiting.append(frame)

    def sent(self, timeout_s: float) -> bool:
        with self._lock:
            self._compute()
        return True

    def _compute(self) -> None:
        """All frames that wait to packets."""
        if self._waiting:
            frames = list(self._waiting)
            self._waiting.clear()
            for name, packets in self.model.accept(frames).items():
                self._packets[name].extend(packets)

    def receive(self, stream: str, timeout_s: float) -> np.ndarray:
        with self._lock:
            if not self._packets[stream]:
                self._compute()
            if not self._packets[stream]:  # computed at once, so nothing is on its way
                raise TransportTimeout(f"{stream}: no packet: no frame is in flight")
            self.model.take_interrupt()
            return self._packets[stream].popleft()

    def wait_interrupt(self, timeout_s: float) -> bool:
        with self._lock:
            self._compute()
            return self.model.take_interrupt()

    def reset_dma(self) -> None:
        with self._lock:
            self._waiting.clear()
            for packets in self._packets.values():
                packets.clear()

    def now_s(self) -> float:
        return time.monotonic()

    def close(self) -> None:
        pass
