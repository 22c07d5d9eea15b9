"""Model of AMD's AXI DMA without scatter-gather ("direct register mode"), a clock at a time.

Rules are those of the product guide PG021, AXI DMA v7.1, web edition of 2025-06-24, named here by the page's
title; timing also of PG022, AXI DataMover v5.1, web edition of 2025-01-09. Where the guide leaves behaviour
undefined the model refuses, and what the guide does not say is called an assumption:

1. "S2MM_DMASR", bit 0, and "MM2S_DMASR": while the channel is halted (RS = 0), a write to LENGTH has no
   effect.
2. "S2MM_LENGTH" and "MM2S_LENGTH": a write that is not zero starts the transfer. Assumption: before it, S2MM
   takes no beat.
3. "S2MM_LENGTH": the number of bytes that came is in LENGTH after the transfer. The last beat of a packet
   (tlast) ends the transfer, so that one transfer takes one packet, however short.
4. "S2MM_LENGTH": a packet that is longer than LENGTH is undefined behaviour. Here: DMAIntErr, and the
   channel halts.
5. "S2MM_DMACR", bit 0: hardware clears RS when an error occurs. Only a reset goes on from there
   (assumption).
6. "S2MM_DMACR", bit 2: Reset resets the whole core. Assumption: within the clock.
7. "S2MM_DMASR", bits 1, 12 and 14: Idle and IOC_Irq are set when a transfer is complete, Err_Irq by an error;
   those two are cleared by writing 1, and drive the interrupt if they are enabled in DMACR (bits 12 and 14).
8. "MM2S_SA": without the realignment engine the address must be a multiple of the memory's width. The page of
   S2MM_DA could not be looked up; the same is assumed of it.
9. PG021, "Features": tdata has 8, 16, 32, 64, 128, 256, 512 or 1,024 bits; a memory port at least 32.
10. Assumption, as no page of PG021 that could be looked up says it: tkeep must be all ones but in a packet's
    last beat, where the valid bytes come first.
11. Assumption: LENGTH or the address written, or RS cleared, while a transfer is under way is a mistake of
    the host; raises `DmaMisuse`.

A transfer counts as complete when the memory has confirmed its last write. `Timing` has the clocks.
"""

import random
from collections import deque
from dataclasses import dataclass
from typing import Protocol

WIDTHS = (8, 16, 32, 64, 128, 256, 512, 1024)
"""Bits of tdata (rule 9)."""
RUN, RESET, IOC_ENABLE, ERROR_ENABLE = 1 << 0, 1 << 2, 1 << 12, 1 << 14
"""Bits of DMACR."""
HALTED, IDLE, IOC, ERROR = 1 << 0, 1 << 1, 1 << 12, 1 << 14
INTERNAL_ERROR, DECODE_ERROR = 1 << 4, 1 << 6
"""Bits of DMASR."""
DMACR, DMASR, ADDRESS, ADDRESS_MSB, LENGTH = 0x00, 0x04, 0x18, 0x1C, 0x28
"""Offsets in a channel ("Direct Register Mode Register Address Map")."""
MM2S, S2MM = 0x00, 0x30
"""Offsets of the channels."""
ALWAYS_ONE = 1 << 1
"""Reserved bit of DMACR that reads as 1."""


class DmaMisuse(RuntimeError):
    """The host or the stream did what the product guide forbids or leaves undefined; one line."""


class Memory(Protocol):
    """What the models need of a memory; `cocotbext.axi.memory.Memory` is one."""

    def read(self, address: int, length: int) -> bytes: ...

    def write(self, address: int, data: bytes) -> None: ...


@dataclass(frozen=True)
class Beat:
    """A beat of an AXI4-Stream: bytes, the bits of tkeep, and tlast."""

    octets: bytes
    keep: int
    last: bool


@dataclass(frozen=True)
class Timing:
    """Clocks of the DMA and of the memory behind it.

    fetch : from LENGTH to MM2S's first beat. 8 from command to address (PG022, "Latency") and 6 from there to
        the first beat (PG021, "Performance").
    write : from S2MM's last beat to the end of its write at the memory. The guide has 39 from the first beat
        to the write's address (PG021, "Performance", typical configuration, with scatter-gather), and 20 for
        the data mover alone (PG022, "Latency", with store and forward).
    response : from there to the memory's response; an assumption, as it depends on the system
    between : after a packet, until S2MM can take a beat again: 2 (PG022, "Latency", without realignment)
    stall : probability per clock that the memory neither gives nor takes a beat
    """

    fetch: int = 14
    write: int = 39
    response: int = 4
    between: int = 2
    stall: float = 0.0


class Channel:
    """Registers of one channel; its subclasses have the stream."""

    def __init__(self, name: str, memory: Memory, bits: int, timing: Timing, *, memory_bits: int, seed: int):
        if bits not in WIDTHS:
            raise DmaMisuse(f"{name}: tdata of {bits} bits: expected one of {WIDTHS}")
        self.name, self.memory, self.octets, self.timing = name, memory, bits // 8, timing
        self.alignment, self.rng = max(memory_bits, 32) // 8, random.Random(seed)
        self.reset()

    def reset(self) -> None:
        self.control = self.address = self.length = 0
        self.status = HALTED
        self.busy = False

    @property
    def interrupt(self) -> bool:
        return bool(self.control & self.status & (IOC_ENABLE | ERROR_ENABLE))

    def read(self, offset: int) -> int:
        if offset == DMACR:
            return self.control | ALWAYS_ONE
        if offset == DMASR:
            return self.status
        if offset == LENGTH:
            return self.length
        return self.address >> 32 if offset == ADDRESS_MSB else self.address & 0xFFFFFFFF

    def write(self, offset: int, value: int) -> None:
        if self.busy and (offset in (ADDRESS, ADDRESS_MSB, LENGTH) or (offset == DMACR and not value & RUN)):
            raise DmaMisuse(f"{self.name}: register {offset:#04x} written while a transfer is under way")
        if offset == DMACR:
            failed = self.status & (INTERNAL_ERROR | DECODE_ERROR)
            self.control = value & (RUN | IOC_ENABLE | ERROR_ENABLE) & ~(RUN if failed else 0)
            self.status = self.status & ~HALTED if self.control & RUN else self.status | HALTED
        elif offset == DMASR:
            self.status &= ~(value & (IOC | ERROR))
        elif offset == ADDRESS:
            self.address = self.address >> 32 << 32 | value
        elif offset == ADDRESS_MSB:
            self.address = value << 32 | self.address & 0xFFFFFFFF
        elif offset == LENGTH and not self.status & HALTED and value:
            if self.address % self.alignment:
                raise DmaMisuse(
                    f"{self.name}: address {self.address:#x}: expected a multiple of {self.alignment}"
                )
            self.length, self.busy = value, True
            self.status &= ~IDLE
            self.begin()

    def begin(self) -> None:
        """A transfer of `length` bytes at `address` starts."""
        raise NotImplementedError

    def complete(self) -> None:
        self.busy = False
        self.status |= IDLE | IOC

    def fail(self, error: int = INTERNAL_ERROR) -> None:
        self.busy = False
        self.control &= ~RUN
        self.status |= HALTED | error | ERROR

    def stalls(self) -> bool:
        return self.rng.random() < self.timing.stall


class Mm2s(Channel):
    """Memory to stream: call `offer` once a clock, then `clock` with whether the offer was taken."""

    def begin(self) -> None:
        data, octets = bytes(self.memory.read(self.address, self.length)), self.octets
        parts = [data[k : k + octets] for k in range(0, len(data), octets)]
        self.queue = deque(
            Beat(part.ljust(octets, b"\0"), (1 << len(part)) - 1, k == len(parts) - 1)
            for k, part in enumerate(parts)
        )
        self.waits = self.timing.fetch

    def reset(self) -> None:
        super().reset()
        self.queue, self.waits, self.offered = deque(), 0, None

    def offer(self) -> Beat | None:
        """The beat that is valid in this clock. What was offered stays so until it is taken."""
        if self.offered is None and self.busy and self.queue and not self.waits and not self.stalls():
            self.offered = self.queue.popleft()
        return self.offered

    def clock(self, taken: bool) -> None:
        self.waits = max(self.waits - 1, 0)
        if self.offered is not None and taken:
            self.offered = None
            if not self.queue:
                self.complete()


class S2mm(Channel):
    """Stream to memory: `ready` says whether a beat is taken in this clock; then call `clock` with that
    beat."""

    def reset(self) -> None:
        super().reset()
        self.received, self.ending, self.rest, self.refuses = 0, None, 0, False

    def begin(self) -> None:
        self.received, self.ending = 0, None

    @property
    def ready(self) -> bool:
        return self.busy and self.ending is None and not self.rest and not self.refuses

    def clock(self, beat: Beat | None) -> None:
        """`beat`: was transferred in this clock."""
        self.rest = max(self.rest - 1, 0)
        self.refuses = self.stalls()
        if self.ending is not None:
            self.ending -= 1
            if self.ending == 0:
                self.length = self.received
                self.complete()
        if beat is None:
            return
        count = beat.keep.bit_count()
        if beat.keep != (1 << count) - 1 or (count < self.octets and not beat.last):
            raise DmaMisuse(f"{self.name}: tkeep {beat.keep:#x} inside a packet: expected all ones")
        if self.received + count > self.length:
            self.fail()
            return
        self.memory.write(self.address + self.received, beat.octets[:count])
        self.received += count
        if beat.last:
            self.ending, self.rest = self.timing.write + self.timing.response, self.timing.between + 1


class Dma:
    """Two channels behind one register space; None where the DMA has none."""

    def __init__(self, mm2s: Channel | None, s2mm: Channel | None):
        self.mm2s, self.s2mm = mm2s, s2mm

    def _channel(self, offset: int) -> tuple[Channel, int]:
        channel = self.s2mm if offset >= S2MM else self.mm2s
        inner = offset - S2MM if offset >= S2MM else offset
        if channel is None or inner not in (DMACR, DMASR, ADDRESS, ADDRESS_MSB, LENGTH):
            raise DmaMisuse(f"register {offset:#04x}: this DMA has none there")
        return channel, inner

    def read(self, offset: int) -> int:
        channel, inner = self._channel(offset)
        return channel.read(inner)

    def write(self, offset: int, value: int) -> None:
        channel, inner = self._channel(offset)
        if inner == DMACR and value & RESET:
            for each in (self.mm2s, self.s2mm):
                if each is not None:
                    each.reset()
            return
        channel.write(inner, value)


class AxiDma(Dma):
    """The channels with their streams.

    mm2s_bits, s2mm_bits : widths of tdata; 0: no such channel
    """

    def __init__(
        self,
        memory: Memory,
        *,
        mm2s_bits: int = 0,
        s2mm_bits: int = 0,
        timing: Timing | None = None,
        memory_bits: int = 32,
        seed: int = 1,
    ):
        timing = timing or Timing()
        known = {"memory_bits": memory_bits, "seed": seed}
        super().__init__(
            Mm2s("MM2S", memory, mm2s_bits, timing, **known) if mm2s_bits else None,
            S2mm("S2MM", memory, s2mm_bits, timing, **known) if s2mm_bits else None,
        )
