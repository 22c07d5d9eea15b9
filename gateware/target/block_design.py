"""What stands around the core in the programmable logic: DMAs, addresses and interrupts.

Vivado's scripts, the host's driver and the simulation with DMAs all take these from here. One clock drives
everything, at the scene's frequency; the processing system gives it.

    memory -- axi_dma_0 MM2S --> fastac_0 s_axis      frames
    memory <- axi_dma_0 S2MM --- fastac_0 m_axis_...  packets of the first output stream
    memory <- axi_dma_1 S2MM --- fastac_0 m_axis_...  packets of the second one, and so on

Every DMA is an AXI DMA in simple mode, without scatter-gather (PG021). The interrupts go through a concat in
the order core, axi_dma_0 MM2S, axi_dma_0 S2MM, axi_dma_1 S2MM, ...
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from fastac.scenes.parts import PARTS

CORE = "fastac_0"
"""Instance of the core in the block design."""
RANGE = 0x1_0000
"""Bytes of address space of each slave, 64 KiB, and distance from one DMA to the next."""
INPUT_PORT = "s_axis"
MIN_LENGTH_BITS, MAX_LENGTH_BITS = 14, 26
"""Width of an AXI DMA's length register: Vivado's default and its largest (PG021, c_sg_length_width)."""
MIN_MEMORY_BITS, MAX_MEMORY_BITS = 32, 1024
"""Width of an AXI DMA's memory port; it must not be less than its stream's (PG021)."""


class BlockDesignError(ValueError):
    """Hardware around which no block design can be built; the message is one line."""


@dataclass(frozen=True)
class Family:
    """A family of devices with a processing system.

    core_address, dma_address : bytes, where the ranges of the core and of the first DMA start: in the window
        of M_AXI_HPM0_FPD (UG1085, system address map) or of M_AXI_GP0 (UG585, system-level address map)
    first_spi : number of the shared peripheral interrupt behind the concat's line 0, as the device tree
        counts: pl_ps_irq0[0] is the GIC's 121 (UG1085), IRQ_F2P[0] its 61 (UG585), and SPIs start at 32
    memory_port_bits : widest data of the port S_AXI_HP0, through which the DMAs reach memory
    address_bits : of the DMAs; beyond 32 their registers have an upper half of the address (PG021)
    """

    name: str
    core_address: int
    dma_address: int
    first_spi: int
    memory_port_bits: int
    address_bits: int

    def dma_at(self, index: int) -> int:
        """Address of DMA number `index`."""
        return self.dma_address + index * RANGE


ZYNQ_ULTRASCALE_PLUS = Family("zynquplus", 0xA000_0000, 0xA001_0000, 121 - 32, 128, 40)
ZYNQ_7000 = Family("zynq7000", 0x43C0_0000, 0x4040_0000, 61 - 32, 64, 32)
FAMILIES = {family.name: family for family in (ZYNQ_ULTRASCALE_PLUS, ZYNQ_7000)}


def family_of(part: str) -> Family:
    """The family of an entry of scenes/parts.py; raises BlockDesignError for another part."""
    if part not in PARTS:
        raise BlockDesignError(f"part {part!r}: expected one of {', '.join(PARTS)}")
    return FAMILIES[PARTS[part].family]


def dma_instance(index: int) -> str:
    """Instance of DMA number `index` in the block design."""
    return f"axi_dma_{index}"


@dataclass(frozen=True)
class Channel:
    """One direction of a DMA: a stream of the core, `stream_bits` wide, in packets of `packet_bytes`.

    output : name of the core's output, such as "depth", or "results" for the records alone; None for frames
    """

    port: str
    stream_bits: int
    packet_bytes: int
    output: str | None = None

    @property
    def memory_bits(self) -> int:
        """Width of the DMA's memory port for this channel."""
        return max(MIN_MEMORY_BITS, self.stream_bits)


@dataclass(frozen=True)
class Dma:
    """AXI DMA number `index` at `address`: frames out of memory (mm2s, only the first), packets into it."""

    index: int
    address: int
    mm2s: Channel | None
    s2mm: Channel

    @property
    def instance(self) -> str:
        return dma_instance(self.index)

    @property
    def channels(self) -> tuple[Channel, ...]:
        return tuple(channel for channel in (self.mm2s, self.s2mm) if channel)

    @property
    def length_bits(self) -> int:
        """Width of its length register, which holds the bytes of a whole packet."""
        longest = max(channel.packet_bytes for channel in self.channels)
        return max(MIN_LENGTH_BITS, longest.bit_length())


@dataclass(frozen=True)
class Interrupt:
    """An interrupt output `pin` of `instance`, level high, at input `line` of the concat."""

    line: int
    instance: str
    pin: str
    spi: int


@dataclass(frozen=True)
class BlockDesign:
    """The block design of one hardware on one part.

    core_address : of the core's registers; each slave has `RANGE` bytes
    dmas : in the order of the core's output streams; the first one sends the frames too
    """

    part: str
    family: Family
    clock_mhz: float
    dmas: tuple[Dma, ...]

    @property
    def core_address(self) -> int:
        return self.family.core_address

    @property
    def addresses(self) -> dict[str, int]:
        """Base address of each slave by its instance."""
        return {CORE: self.core_address} | {dma.instance: dma.address for dma in self.dmas}

    @cached_property
    def interrupts(self) -> tuple[Interrupt, ...]:
        """In the order of the concat's inputs."""
        pins = [(CORE, "interrupt")]
        for dma in self.dmas:
            pins += [(dma.instance, "mm2s_introut")] if dma.mm2s else []
            pins += [(dma.instance, "s2mm_introut")]
        return tuple(
            Interrupt(line, instance, pin, self.family.first_spi + line)
            for line, (instance, pin) in enumerate(pins)
        )


def block_design(hardware: Mapping) -> BlockDesign:
    """The block design for what `hardware.json` says of the hardware.

    Raises BlockDesignError where its streams are not frame packets, which AXI DMAs need, where a stream is
    wider than a DMA's, or a packet is longer than its length register can say.
    """
    if hardware.get("streams") != "packets":
        raise BlockDesignError(
            f"hardware.streams {hardware.get('streams', 'video')!r}: AXI DMAs need 'packets'"
        )
    frame, family = hardware["frame"], family_of(hardware["part"])
    source = Channel(frame["port"], 8 * frame["bytes_per_beat"], frame["bytes"])
    sinks = [
        Channel(output["port"], 8 * output["bytes_per_beat"], output["packet_bytes"], output["name"])
        for output in hardware["outputs"]
    ]
    results = hardware["results"]
    if results["port"] is not None:
        sinks.append(Channel(results["port"], 32, results["record_bytes"], "results"))
    for channel in (source, *sinks):
        if channel.stream_bits > MAX_MEMORY_BITS:
            raise BlockDesignError(
                f"{channel.port}: {channel.stream_bits} bits: an AXI DMA takes {MAX_MEMORY_BITS} at most"
            )
        if channel.packet_bytes.bit_length() > MAX_LENGTH_BITS:
            raise BlockDesignError(
                f"{channel.port}: packets of {channel.packet_bytes} bytes: an AXI DMA takes"
                f" {(1 << MAX_LENGTH_BITS) - 1} at most"
            )
    dmas = tuple(Dma(k, family.dma_at(k), source if k == 0 else None, sink) for k, sink in enumerate(sinks))
    return BlockDesign(hardware["part"], family, hardware["clock_mhz"], dmas)
