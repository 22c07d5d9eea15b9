"""An AXI DMA that moves whole frames and packets, without streams or clocks, and the memory behind it.

Its registers are those of sim/dma/axi_dma.py. It serves where no DMA could be, behind video streams, and in
stand-ins for boards.
"""

from collections.abc import Callable

from fastac.sim.dma.axi_dma import DECODE_ERROR, Channel, Dma, Timing

STREAM_BITS = MEMORY_BITS = 32


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


class PacketChannel(Channel):
    """A channel whose transfers wait, once begun, until `PacketDma` moves them."""

    def begin(self) -> None:
        pass


class PacketDma(Dma):
    """Both channels, and what their streams do; `changed` is called when an interrupt may come."""

    def __init__(self, memory: Memory, changed: Callable[[], None]):
        self.memory, self.changed = memory, changed
        known = {"memory_bits": MEMORY_BITS, "seed": 1}
        super().__init__(
            *(PacketChannel(name, memory, STREAM_BITS, Timing(), **known) for name in ("MM2S", "S2MM"))
        )

    def frame(self) -> bytes | None:
        """The bytes that are to be sent, if any; `sent` says when they are."""
        source = self.mm2s
        if not source.busy:
            return None
        try:
            return self.memory.read(source.address, source.length)
        except ValueError:
            self._fail(source, DECODE_ERROR)
            return None

    @property
    def frame_is_cut(self) -> bool:
        """Whether no frame is to be sent any more: a reset ends one in the middle."""
        return not self.mm2s.busy

    def sent(self) -> None:
        """The last byte has left."""
        if self.mm2s.busy:
            self.mm2s.complete()
            self.changed()

    @property
    def wants(self) -> int | None:
        """Bytes that may come, None where no packet may."""
        return self.s2mm.length if self.s2mm.busy else None

    def deliver(self, packet: bytes) -> None:
        """A whole packet has come. One that is longer than the transfer is an internal error."""
        sink = self.s2mm
        if not sink.busy:
            return
        if len(packet) > sink.length:
            self._fail(sink)
            return
        try:
            self.memory.write(sink.address, packet)
        except ValueError:
            self._fail(sink, DECODE_ERROR)
            return
        sink.length = len(packet)
        sink.complete()
        self.changed()

    def _fail(self, channel: Channel, *error: int) -> None:
        channel.fail(*error)
        self.changed()
