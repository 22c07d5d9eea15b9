"""The driver: frames in, results with units and flags out, whatever the hardware is reached through.

from fastac.driver.description import read
from fastac.driver.driver import Driver
from fastac.driver.transports.uio import UioTransport

description = read("hardware.json")
with Driver(UioTransport(description), description) as driver:
    for found in driver.frames(camera):        # any iterable of (H, W, C) uint8
        print(found.frame, found.time_s, found.force_n, found.reasons)
"""

import contextlib
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from fastac.driver.description import Description
from fastac.driver.packets import Found, PacketError, join, nothing
from fastac.driver.receiver import Receiver
from fastac.driver.registers import WORD_MASK, Registers
from fastac.driver.transports.transport import DmaError, PacketSizeError, Transport, TransportTimeout, until
from fastac.gateware.bus.register_map import ID

TIMEOUT_S = 1.0


class DriverError(RuntimeError):
    """Hardware that is not what it should be, or a command that it did not carry out; one line."""


@dataclass
class _Sent:
    """A frame in flight."""

    number: int
    at_s: float
    lost: bool = False


class Driver:
    """One core behind a transport.

    timeout_s : how long the result of a frame may take before it counts as lost
    any_bundle : take hardware with another bundle's calibration, or with half of one, to load one

    Frames go in by one iteration at a time; registers may be used by any thread meanwhile. A frame whose
    result does not come is given as lost, DMAs and core are reset, and the next frames go on; `counts` says
    how often. Raises DriverError where the hardware is other hardware.
    """

    def __init__(
        self,
        transport: Transport,
        description: Description,
        *,
        timeout_s: float = TIMEOUT_S,
        any_bundle: bool = False,
    ):
        self.transport, self.description, self.timeout_s = transport, description, timeout_s
        self.registers = Registers(description, transport.read, transport.write)
        self.trouble: str = ""
        """The last error that cost a frame, in one line."""
        self._busy = threading.Lock()
        self._failed = False
        self._check_version()
        if not any_bundle:
            self.check_bundle()
        self._receiver = Receiver(transport, self.registers, description, timeout_s=timeout_s)
        self.counts = self._receiver.counts
        self._number = 0
        status = self.registers.fields("STATUS")
        if status["busy"] or self.registers.read("FRAME_COUNT"):
            # Whoever used it before may have left frames in it; none can run while half of a calibration is.
            if not status["loading"]:
                self._restart()
        else:
            self._control()
        self.registers.take_errors()

    def __enter__(self) -> "Driver":
        return self

    def __exit__(self, *error) -> None:
        self.close()

    def close(self) -> None:
        """Release the transport."""
        self.transport.close()

    # Identity and control

    def _check_version(self) -> None:
        read, description = self.registers.read, self.description
        if (found := read("ID")) != ID:
            raise DriverError(f"ID = {found:#010x}: expected {ID:#010x}: no core of ours is at this address")
        if (found := read("VERSION")) != description.version:
            raise DriverError(f"VERSION = {found}: hardware.json is of version {description.version}")

    def check_bundle(self) -> None:
        """Raise DriverError unless BUNDLE_HASH is that of the description."""
        if (found := self.bundle_hash) != self.description.hash_word:
            raise DriverError(
                f"BUNDLE_HASH = {found:016x}: hardware.json is of bundle {self.description.hash_word:016x};"
                " program its bitstream, or load its calibration"
            )

    @property
    def bundle_hash(self) -> int:
        """The first 64 bits of the hash of the bundle that the hardware computes with."""
        return self.registers.read("BUNDLE_HASH_HIGH") << 32 | self.registers.read("BUNDLE_HASH_LOW")

    def _control(self, **bits: int) -> None:
        self.registers.write("CONTROL", **{"enable": 1, "interrupt_enable": 1, **bits})

    def _restart(self) -> None:
        """End everything in flight and begin anew: core, DMAs, numbers of frames.

        Where the input was cut inside a frame, the core takes what comes next for the rest of it. So a frame
        of zeros follows: it is this rest, or else a frame with a number, whose packets are stale. It must not
        become the background: while a frame for that is awaited, the core drops the zeros in either case.
        """
        clear = {"clear_results": 1} if self._receiver.has_fifo else {}
        self._control(soft_reset=1, **clear)
        self._sent(self.timeout_s)  # the core drops what is left of a frame, so a DMA that is well ends it
        self.transport.reset_dma()
        self._receiver.restart()
        self._wait_idle()
        captures = self.registers.read("CONTROL", "capture_background")
        if captures:
            self._control(enable=0)
        self._begin(np.zeros(self.description.frame.format.bytes, np.uint8))
        if not self._sent(self.timeout_s):
            raise DriverError("after a reset the hardware takes no frame; load the bitstream anew")
        if captures:
            self._control()
        self._wait_idle()
        self._number = self.registers.read("FRAME_COUNT")

    def _begin(self, octets: np.ndarray) -> None:
        """Begin to send a frame; after a reset the rest of a packet may come to memory meanwhile."""
        while True:
            try:
                return self.transport.send(octets)
            except PacketSizeError:
                if not self._receiver.settling:
                    raise
                self.counts.stale += 1

    def _sent(self, timeout_s: float) -> bool:
        """Whether all frames have been taken; what comes to memory meanwhile may be the rest of a packet."""
        while True:
            try:
                return self.transport.sent(timeout_s)
            except PacketSizeError:
                self.counts.stale += 1
            except DmaError:
                return False

    def _pause(self, timeout_s: float) -> None:
        """Let time pass after a reset."""
        with contextlib.suppress(DmaError):  # of what was under way
            self.transport.wait_interrupt(timeout_s)

    def _wait_idle(self) -> None:
        """Wait until no frame is in flight."""

        def idle() -> bool:
            self._sent(0)  # so that packets are taken meanwhile
            return not self.registers.read("STATUS", "busy")

        if not until(idle, self.transport, self.timeout_s, self._pause):
            raise DriverError("STATUS.busy does not end: is every output stream read?")

    def soft_reset(self) -> None:
        """Discard everything in the hardware; no iteration over frames may be running."""
        with self._alone():
            self._restart()

    def capture_background(self, frame: np.ndarray) -> Found:
        """Send a frame (H, W, C) uint8 of the untouched sensor, which becomes the background.

        Returns what was found in it. Raises DriverError where the hardware did not take it, twice.
        """
        with self._alone():
            self._control(capture_background=1)
            found = self._next(deque([self._send(frame)]))
            if found.lost:  # the core may still wait for it, and must not take another frame instead
                found = self._next(deque([self._send(frame)]))
            if found.lost or self.registers.read("CONTROL", "capture_background"):
                raise DriverError(f"the background was not captured: {self.trouble or 'capture it again'}")
            return found

    def load_calibration(self, words: np.ndarray) -> None:
        """Load the image (words,) uint32 that `fastac calibration` wrote. Takes one register write a word.

        Raises ValueError where the image is for other hardware, DriverError where it was refused.
        """
        registers = self.registers
        if "CALIBRATION" not in registers:
            raise ValueError("calibration: the hardware takes none (hardware.weights = 'baked')")
        expected, layout = registers.read("CALIBRATION_WORDS"), registers.read("CALIBRATION_LAYOUT")
        if len(words) != expected:
            raise ValueError(f"calibration: {len(words)} words: the hardware takes {expected}")
        if int(words[0]) != layout:
            raise ValueError(f"calibration: layout {int(words[0]):#010x}: the hardware's is {layout:#010x}")
        with self._alone():
            self._control(enable=0)
            self._wait_idle()
            self._control(enable=0, restart_calibration=1)
            registers.take_errors()
            for word in words.tolist():
                registers.write("CALIBRATION", word)
            errors, loading = registers.take_errors(), registers.read("STATUS", "loading")
            if "calibration_refused" in errors or loading:
                raise DriverError(
                    "calibration: refused by the hardware; no frame is computed until one is whole"
                )
            self._restart()
        wanted = int(words[-1]) << 32 | int(words[-2])
        if self.bundle_hash != wanted:
            raise DriverError(f"calibration: BUNDLE_HASH = {self.bundle_hash:016x}: expected {wanted:016x}")

    # Frames

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Holds the lock of the frames, or raises DriverError at once where another thread has it."""
        if not self._busy.acquire(blocking=False):
            raise DriverError("frames are running already: end that iteration first")
        try:
            yield
        finally:
            self._busy.release()

    def frames(self, source: Iterable[np.ndarray], *, in_flight: int | None = None) -> Iterator[Found]:
        """What the hardware finds in each frame of `source`, (H, W, C) uint8, in order; none is left out.

        in_flight : frames that are sent before the first one's result is taken. None: as many as the
            transport can hold, for the highest rate. 1: each frame is answered before the next one is asked
            for, which gives the least delay with a camera that is slower than the hardware.
        """
        limit = min(in_flight or self.transport.frames_in_flight, self.transport.frames_in_flight)
        with self._alone():
            waiting: deque[_Sent] = deque()
            try:
                for frame in source:
                    while waiting and (len(waiting) >= limit or self._failed):
                        yield self._next(waiting)
                    waiting.append(self._send(frame))
                    if limit == 1:  # the source may take long to give the next one
                        yield self._next(waiting)
                while waiting:
                    yield self._next(waiting)
            finally:  # left early: what is in flight would be taken for the results of later frames
                while waiting:
                    self._next(waiting)

    def batches(self, source: Iterable[np.ndarray], size: int) -> Iterator[Found]:
        """The same as arrays of `size` frames each, the last one of what is left."""
        results = self.frames(source)
        while some := list(islice(results, size)):
            yield join(some)

    def _send(self, frame: np.ndarray) -> _Sent:
        octets = self._octets(frame)
        self._number = self._number + 1 & WORD_MASK
        sent = _Sent(self._number, self.transport.now_s())
        self.counts.sent += 1
        try:
            self._begin(octets)
        except (DmaError, TransportTimeout) as error:
            self._fail(error)
            sent.lost = True
        return sent

    def _octets(self, frame: np.ndarray) -> np.ndarray:
        """The frame as it lies in memory, (bytes,) uint8."""
        facts = self.description.frame
        if frame.shape != facts.shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}: expected {facts.shape} uint8")
        if facts.format.bytes_per_pixel == len(facts.channels):
            return np.ascontiguousarray(frame).reshape(-1)
        octets = np.zeros((*facts.shape[:2], facts.format.bytes_per_pixel), np.uint8)
        octets[..., : len(facts.channels)] = frame
        return octets.reshape(-1)

    def _fail(self, error: Exception) -> None:
        """Take note of an error that needs a restart."""
        self.trouble = str(error)
        if self._failed:  # it is the same trouble still
            return
        self._failed = True
        if isinstance(error, TransportTimeout):
            self.counts.timeouts += 1
        else:
            self.counts.dma_errors += 1

    def _next(self, waiting: deque[_Sent]) -> Found:
        """The result of the oldest frame in flight, which leaves `waiting`."""
        sent, found = waiting.popleft(), None
        if not sent.lost:
            try:
                collected = self._receiver.collect(sent.number)
                if collected is None:
                    self.trouble = self._receiver.missing
                else:
                    now_s = self.transport.now_s()
                    found = Found(self.description, *collected, False, sent.at_s, now_s)
            except (DmaError, TransportTimeout, PacketError) as error:
                self._fail(error)
                sent.lost = True
        if sent.lost and self._failed:
            for other in waiting:
                other.lost = True
            self._restart()
            self._failed = False
        if found is None:
            self.counts.lost += 1
            return nothing(self.description, sent.number, sent.at_s)
        return found
