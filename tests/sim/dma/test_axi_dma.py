"""Each rule of the model of AXI DMA, with a stream or a host that breaks it."""

import pytest
from cocotbext.axi.memory import Memory

from fastac.sim.dma.axi_dma import (
    ADDRESS,
    ADDRESS_MSB,
    DMACR,
    DMASR,
    ERROR,
    ERROR_ENABLE,
    HALTED,
    IDLE,
    INTERNAL_ERROR,
    IOC,
    IOC_ENABLE,
    LENGTH,
    MM2S,
    RESET,
    RUN,
    S2MM,
    AxiDma,
    Beat,
    DmaMisuse,
    Timing,
)

START = RUN | IOC_ENABLE | ERROR_ENABLE
FULL = 0xF
PLACE = 0x1000
SIZE = 1 << 33


@pytest.fixture
def dma() -> AxiDma:
    return AxiDma(Memory(SIZE), mm2s_bits=32, s2mm_bits=32)


def receive(dma: AxiDma, length: int) -> None:
    dma.write(S2MM + DMACR, START)
    dma.write(S2MM + ADDRESS, PLACE)
    dma.write(S2MM + LENGTH, length)


def packet(data: bytes, octets: int = 4) -> list[Beat]:
    starts = range(0, len(data), octets)
    return [Beat(data[k : k + octets], (1 << octets) - 1, k + octets >= len(data)) for k in starts]


def stream(dma: AxiDma, beats: list[Beat], clocks: int = 200) -> list[int]:
    """Offer beats as fast as they are taken; returns the clock of each transfer."""
    taken = []
    for clock in range(clocks):
        beat = beats[len(taken)] if dma.s2mm.ready and len(taken) < len(beats) else None
        if beat is not None:
            taken.append(clock)
        dma.s2mm.clock(beat)
    return taken


def test_a_packet_lies_in_memory_after_one_transfer(dma):
    data = bytes(range(40))
    receive(dma, 64)
    assert stream(dma, packet(data)) == list(range(10))
    assert bytes(dma.s2mm.memory.read(PLACE, 40)) == data
    assert dma.read(S2MM + LENGTH) == 40  # rule 3
    assert dma.read(S2MM + DMASR) & (IDLE | IOC | HALTED) == IDLE | IOC  # rule 7
    assert dma.s2mm.interrupt
    dma.write(S2MM + DMASR, IOC)
    assert not dma.s2mm.interrupt


def test_the_interrupt_comes_with_the_memory_s_last_response(dma):
    receive(dma, 8)
    timing = Timing()
    for k, beat in enumerate(packet(bytes(8))):
        assert dma.s2mm.ready, k
        dma.s2mm.clock(beat)
    for _ in range(timing.write + timing.response):
        assert not dma.s2mm.interrupt
        dma.s2mm.clock(None)
    assert dma.s2mm.interrupt


def test_tlast_ends_a_transfer_and_what_follows_waits(dma):
    """Rule 3: a row of video is a packet, so one transfer takes one row of a frame."""
    receive(dma, 1024)
    rows = [packet(bytes([row]) * 16) for row in range(4)]
    assert len(stream(dma, [beat for row in rows for beat in row])) == 4
    assert dma.read(S2MM + LENGTH) == 16
    receive(dma, 1024)
    assert len(stream(dma, rows[1])) == 4


def test_a_packet_longer_than_length_is_an_error(dma):
    """Rules 4 and 5."""
    receive(dma, 16)
    assert len(stream(dma, packet(bytes(20)))) == 5
    assert dma.read(S2MM + DMASR) & (HALTED | INTERNAL_ERROR | ERROR | IOC) == HALTED | INTERNAL_ERROR | ERROR
    assert not dma.read(S2MM + DMACR) & RUN
    assert dma.s2mm.interrupt
    receive(dma, 64)  # without a reset nothing goes on
    assert not dma.s2mm.ready
    dma.write(S2MM + DMACR, RESET)
    receive(dma, 64)
    assert dma.s2mm.ready


def test_a_halted_channel_ignores_length(dma):
    """Rule 1."""
    dma.write(S2MM + LENGTH, 64)
    assert not dma.s2mm.ready
    assert dma.read(S2MM + DMASR) == HALTED
    dma.write(S2MM + DMACR, START)
    assert not dma.s2mm.ready
    assert dma.read(S2MM + DMASR) == 0


def test_a_length_of_zero_starts_nothing(dma):
    """Rule 2."""
    receive(dma, 0)
    assert not dma.s2mm.ready


def test_a_reset_resets_both_channels(dma):
    """Rule 6."""
    receive(dma, 64)
    dma.write(MM2S + DMACR, RESET)
    assert not dma.s2mm.ready
    assert dma.read(S2MM + DMASR) == dma.read(MM2S + DMASR) == HALTED


def test_interrupts_that_are_not_enabled_stay_silent(dma):
    dma.write(S2MM + DMACR, RUN)
    dma.write(S2MM + ADDRESS, PLACE)
    dma.write(S2MM + LENGTH, 8)
    stream(dma, packet(bytes(8)))
    assert dma.read(S2MM + DMASR) & IOC
    assert not dma.s2mm.interrupt


@pytest.mark.parametrize(
    ("beat", "message"),
    [(Beat(bytes(4), 0b0011, False), "tkeep 0x3"), (Beat(bytes(4), 0b1101, True), "tkeep 0xd")],
)
def test_bytes_without_value_inside_a_packet_are_refused(dma, beat, message):
    """Rule 10."""
    receive(dma, 64)
    with pytest.raises(DmaMisuse, match=message):
        dma.s2mm.clock(beat)


def test_a_last_beat_may_be_incomplete(dma):
    receive(dma, 64)
    stream(dma, [Beat(b"abcd", FULL, False), Beat(b"ef\0\0", 0b0011, True)])
    assert dma.read(S2MM + LENGTH) == 6


def test_addresses_are_aligned_without_the_realignment_engine(dma):
    """Rule 8."""
    dma.write(S2MM + DMACR, START)
    dma.write(S2MM + ADDRESS, PLACE + 2)
    with pytest.raises(DmaMisuse, match="address 0x1002: expected a multiple of 4"):
        dma.write(S2MM + LENGTH, 64)


@pytest.mark.parametrize("bits", [24, 96, 384, 2048])
def test_widths_that_are_no_power_of_two_are_refused(bits):
    """Rule 9: the widths of video: BGR at one lane, normals at one and four lanes."""
    with pytest.raises(DmaMisuse, match=f"tdata of {bits} bits"):
        AxiDma(Memory(SIZE), s2mm_bits=bits)


@pytest.mark.parametrize(("register", "value"), [(LENGTH, 8), (ADDRESS, PLACE), (DMACR, 0)])
def test_a_transfer_under_way_must_not_be_changed(dma, register, value):
    """Rule 11."""
    receive(dma, 64)
    with pytest.raises(DmaMisuse, match="while a transfer is under way"):
        dma.write(S2MM + register, value)


def test_registers_that_are_not_there_are_refused():
    dma = AxiDma(Memory(SIZE), s2mm_bits=32)
    with pytest.raises(DmaMisuse, match="register 0x00"):
        dma.read(MM2S + DMACR)
    with pytest.raises(DmaMisuse, match="register 0x38"):
        dma.read(S2MM + 0x08)


def test_memory_to_stream(dma):
    data = bytes(range(1, 19))
    dma.mm2s.memory.write(1 << 32, data)
    dma.write(MM2S + DMACR, START)
    dma.write(MM2S + ADDRESS, 0)
    dma.write(MM2S + ADDRESS_MSB, 1)
    dma.write(MM2S + LENGTH, len(data))
    found, at = [], []
    for clock in range(60):
        offer, taken = dma.mm2s.offer(), clock % 3 == 0
        if offer is not None and taken:
            found.append(offer)
            at.append(clock)
        dma.mm2s.clock(taken)
    assert b"".join(beat.octets for beat in found)[: len(data)] == data
    assert [beat.last for beat in found] == [False] * 4 + [True]
    assert [beat.keep for beat in found] == [FULL] * 4 + [0b0011]
    assert at[0] >= Timing().fetch
    assert dma.mm2s.interrupt
    assert dma.read(MM2S + ADDRESS_MSB) == 1


def test_stalls_of_the_memory_lose_nothing():
    dma = AxiDma(Memory(SIZE), s2mm_bits=32, timing=Timing(stall=0.5))
    data = bytes(range(200))
    receive(dma, 200)
    at = stream(dma, packet(data), clocks=400)
    assert at[-1] > 70
    assert bytes(dma.s2mm.memory.read(PLACE, 200)) == data
