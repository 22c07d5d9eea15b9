"""An AXI DMA as its host sees it, for whole frames and packets, and the memory behind it.

Registers and their order of use are those of PG021 ("Register Space", "Direct Register Mode (Simple DMA)").
There are no streams here and no clocks: sim/dma/axi_dma.py is the model with both. This one serves where no
DMA could be, behind video streams, and in the stand-ins for boards.
"""

from collections.abc import Callable

MM2S, S2MM = 0x00, 0x30
DMACR, DMASR, ADDRESS, ADDRESS_MSB, LENGTH = 0x00, 0x04, 0x18, 0x1C, 0x28
RUN, RESET, IOC_ENABLE, ERROR_ENABLE = 1 << 0, 1 << 2, 1 << 12, 1 << 14
HALTED, IDLE, INTERNAL_ERROR, DECODE_ERROR = 1 << 0, 1 << 1, 1 << 4, 1 << 6
IOC, ERROR = 1 << 12, 1 << 14


class Memory:
    """Bytes at a physical address: a bytearray or a map of a file."""

    def __init__(self, address: int, octets):
        self.address, self.octets = address, octets

    def _at(self, address: int, count: int) -> slice:
        start = address - self.address
        if start < 0 or start + count > len(self.octets):
            raise ValueError(f"memory {address:#x}, {count} bytes: nothing is there")
        return slice(start, start + count)

    def read(self, address: int, count: int) -> bytes:
        return bytes(self.octets[self._at(address, count)])

    def write(self, address: int, octets: bytes) -> None:
        self.octets[self._at(address, len(octets))] = octets


class _Direction:
    """Registers of one direction. `pending`: (address, bytes) of a transfer that has begun."""

    def __init__(self):
        self.reset()

    def reset(self) -> None:
        self.control, self.status, self.address, self.length = 0, HALTED, 0, 0
        self.pending: tuple[int, int] | None = None

    def read(self, register: int) -> int:
        values = {DMACR: self.control, DMASR: self.status, LENGTH: self.length}
        values |= {ADDRESS: self.address & 0xFFFFFFFF, ADDRESS_MSB: self.address >> 32}
        return values.get(register, 0)

    def write(self, register: int, value: int) -> None:
        if register == DMACR:
            self.control = value
            self.status = self.status & ~HALTED if value & RUN else self.status | HALTED
        elif register == DMASR:
            self.status &= ~(value & (IOC | ERROR))
        elif register == ADDRESS:
            self.address = self.address >> 32 << 32 | value
        elif register == ADDRESS_MSB:
            self.address = self.address & 0xFFFFFFFF | value << 32
        elif register == LENGTH and value and not self.status & HALTED and self.pending is None:
            self.length, self.pending = value, (self.address, value)
            self.status &= ~IDLE

    def end(self, moved: int | None = None) -> None:
        """The transfer is complete."""
        self.pending = None
        self.status |= IDLE | IOC
        if moved is not None:
            self.length = moved

    def fail(self, error: int) -> None:
        """An error: the channel halts until it is reset."""
        self.pending = None
        self.status |= error | ERROR | HALTED
        self.control &= ~RUN

    @property
    def interrupt(self) -> bool:
        return bool(self.status & self.control & (IOC | ERROR))


class PacketDma:
    """Both directions, and what the streams do with them; `changed` is called when an interrupt may come."""

    def __init__(self, memory: Memory, changed: Callable[[], None]):
        self.memory, self.changed = memory, changed
        self.directions = {MM2S: _Direction(), S2MM: _Direction()}

    def _of(self, offset: int) -> tuple[_Direction, int]:
        base = S2MM if offset >= S2MM else MM2S
        return self.directions[base], offset - base

    def read(self, offset: int) -> int:
        direction, register = self._of(offset)
        return direction.read(register)

    def write(self, offset: int, value: int) -> None:
        direction, register = self._of(offset)
        if register == DMACR and value & RESET:
            for each in self.directions.values():
                each.reset()
            return
        direction.write(register, value)

    def interrupt(self, base: int) -> bool:
        return self.directions[base].interrupt

    def frame(self) -> bytes | None:
        """The bytes that are to be sent, if any; `sent` says when they are."""
        source = self.directions[MM2S]
        if source.pending is None:
            return None
        try:
            return self.memory.read(*source.pending)
        except ValueError:
            self._fail(source, DECODE_ERROR)
            return None

    @property
    def frame_is_cut(self) -> bool:
        """Whether no frame is to be sent any more: a reset ends one in the middle."""
        return self.directions[MM2S].pending is None

    def sent(self) -> None:
        """The last byte has left."""
        source = self.directions[MM2S]
        if source.pending is not None:
            source.end()
            self.changed()

    @property
    def wants(self) -> int | None:
        """Bytes that may come, None where no packet may."""
        pending = self.directions[S2MM].pending
        return pending[1] if pending else None

    def deliver(self, packet: bytes) -> None:
        """A whole packet has come. One that is longer than the transfer is an internal error."""
        sink = self.directions[S2MM]
        if sink.pending is None:
            return
        address, length = sink.pending
        if len(packet) > length:
            self._fail(sink, INTERNAL_ERROR)
            return
        try:
            self.memory.write(address, packet)
        except ValueError:
            self._fail(sink, DECODE_ERROR)
            return
        sink.end(len(packet))
        self.changed()

    def _fail(self, direction: _Direction, error: int) -> None:
        direction.fail(error)
        self.changed()
