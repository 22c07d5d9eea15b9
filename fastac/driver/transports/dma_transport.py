"""Frames and packets by AXI DMAs: what every transport with memory and DMAs does, on a board or simulated.

Frames leave memory through `axi_dma_0`; the k-th output stream comes to memory through `axi_dma_k`
(gateware/target/block_design.py). A buffer that hardware and host share has places for two frames, so that
one is filled while the other is sent, and for as many packets of each stream as frames may be in flight, and
one more, so that a stream never waits for the host to look.
"""

import threading
from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from fastac.driver.description import Description
from fastac.driver.transports.axi_dma import MM2S, S2MM, Channel, Window
from fastac.driver.transports.transport import PacketSizeError, TransportError, TransportTimeout, until
from fastac.gateware.target.block_design import dma_instance

MOST_IN_FLIGHT = 7
"""Frames that the core holds at most (`FRAMES_IN_FLIGHT` in gateware/stream/frame_guard.py, less one)."""
FRAME_SLOTS = 2
ALIGNMENT = 4096
"""Places in the buffer begin at multiples of it: pages, and more than any stream's width (PG021)."""


class Memory(Protocol):
    """A buffer of `size` bytes at the physical address `address`."""

    address: int
    size: int

    def write(self, offset: int, octets: np.ndarray) -> None:
        """Write uint8 where the hardware then reads it."""

    def read(self, offset: int, count: int) -> np.ndarray:
        """A copy, uint8, of what the hardware has written."""


class _Slots:
    """Places of equal size in the buffer, from byte `start` on, taken in turn."""

    def __init__(self, start: int, size: int, count: int):
        self.size, self.step = size, -(-size // ALIGNMENT) * ALIGNMENT
        self.start, self.end = start, start + count * self.step
        self.free = deque(start + k * self.step for k in range(count))


class _Stream:
    """A stream to memory: its channel, its places, and the packets that are there, oldest first."""

    def __init__(self, channel: Channel, slots: _Slots):
        self.channel, self.slots = channel, slots
        self.filling: int | None = None
        self.ready: deque[int] = deque()


def buffer_bytes(description: Description) -> int:
    """Bytes of the buffer that `DmaTransport` needs."""
    return _layout(description)[-1].end


def _layout(description: Description) -> list[_Slots]:
    """Places of the frames, then those of each stream's packets."""
    found = [_Slots(0, description.frame.format.bytes, FRAME_SLOTS)]
    for size in description.streams_out.values():
        found.append(_Slots(found[-1].end, size, frames_in_flight(description) + 1))
    return found


def frames_in_flight(description: Description) -> int:
    """Frames that must be on their way for the full rate: those in the core, one that is being sent, and one
    whose packet is being written."""
    in_core = -(-description.result_cycles // description.frame_beats)
    return min(in_core + 2, MOST_IN_FLIGHT)


class DmaTransport:
    """A `Transport` over a core's registers, DMAs and a buffer; subclasses say how to wait.

    core, dmas : registers of the core, and of the DMAs in the order of the output streams
    memory : the buffer, at least `buffer_bytes(description)`
    wide : the DMAs have addresses of more than 32 bits
    """

    def __init__(
        self, description: Description, core: Window, dmas: Sequence[Window], memory: Memory, *, wide: bool
    ):
        frames, *slots = _layout(description)
        if memory.size < slots[-1].end:
            raise TransportError(f"buffer of {memory.size} bytes: expected {slots[-1].end} or more")
        self.description, self.core, self.memory = description, core, memory
        self.frames_in_flight = frames_in_flight(description)
        self.interrupt_status = next(
            register.offset for register in description.registers if register.name == "INTERRUPT_STATUS"
        )
        self._lock = threading.RLock()
        self._frames = frames
        self._source = Channel(dmas[0], MM2S, f"{dma_instance(0)} MM2S", wide=wide)
        self._streams = {
            name: _Stream(Channel(window, S2MM, f"{dma_instance(k)} S2MM", wide=wide), places)
            for k, (name, window, places) in enumerate(zip(description.streams_out, dmas, slots, strict=True))
        }
        self.reset_dma()

    def wait_interrupt(self, timeout_s: float) -> bool:
        raise NotImplementedError

    def now_s(self) -> float:
        raise NotImplementedError

    def read(self, offset: int) -> int:
        return self.core.read(offset)

    def write(self, offset: int, value: int) -> None:
        self.core.write(offset, value)

    def clear_interrupt(self) -> None:
        """Clear the core's interrupt."""
        self.write(self.interrupt_status, 1)

    def patience_s(self, timeout_s: float) -> float:
        """The timeout that counts: `timeout_s`, unless a transport's time passes otherwise."""
        return timeout_s

    def reset_dma(self) -> None:
        with self._lock:
            for stream in self._streams.values():
                stream.channel.reset()
            self._source.busy = False
            self._source.start()
            for stream in self._streams.values():
                places = [stream.filling, *stream.ready]
                stream.slots.free.extend(place for place in places if place is not None)
                stream.filling = None
                stream.ready.clear()
                stream.channel.start()
                self._fill(stream)

    def _fill(self, stream: _Stream) -> None:
        """Let the next packet come, where there is a place for it."""
        if stream.filling is None and stream.slots.free:
            stream.filling = stream.slots.free.popleft()
            stream.channel.transfer(self.memory.address + stream.filling, stream.slots.size)

    def _service(self) -> None:
        """See what the DMAs have done. Raises DmaError where they report errors."""
        if self._source.busy:
            self._source.done()
        for name, stream in self._streams.items():
            if stream.filling is None or not stream.channel.done():
                continue
            moved = stream.channel.moved()
            is_whole = moved == stream.slots.size
            (stream.ready if is_whole else stream.slots.free).append(stream.filling)
            stream.filling = None
            self._fill(stream)
            if not is_whole:
                raise PacketSizeError(f"{name}: a packet of {moved} bytes: expected {stream.slots.size}")

    def _serve(self, name: str | None = None) -> bool:
        """Service the DMAs; whether a packet of the stream `name` is there, or the frames' DMA is idle."""
        with self._lock:
            self._service()
            return not self._source.busy if name is None else bool(self._streams[name].ready)

    def send(self, frame: np.ndarray) -> None:
        place = self._frames.free[0]
        self.memory.write(place, frame)
        if not self.sent(1.0):
            raise TransportTimeout(f"{self._source.name}: the hardware takes no more of a frame")
        with self._lock:
            self._frames.free.rotate(-1)
            self._source.transfer(self.memory.address + place, frame.size)

    def sent(self, timeout_s: float) -> bool:
        return until(self._serve, self, self.patience_s(timeout_s), self.wait_interrupt)

    def receive(self, stream: str, timeout_s: float) -> np.ndarray:
        patience_s = self.patience_s(timeout_s)
        if not until(lambda: self._serve(stream), self, patience_s, self.wait_interrupt):
            raise TransportTimeout(f"{stream}: no packet within {patience_s:g} s")
        with self._lock:
            of = self._streams[stream]
            place = of.ready.popleft()
            octets = self.memory.read(place, of.slots.size)
            of.slots.free.append(place)
            self._fill(of)
        return octets
