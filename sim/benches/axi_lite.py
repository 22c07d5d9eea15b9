"""cocotb testbench of AxiLiteSlave in front of six words of memory, the last of them read-only."""

import os
import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge, gather

from fastac.sim.benches.host import DECERR, OKAY, SLVERR, read, reset, start, write

WORDS, SIZE = 6, 1 << int(os.environ["ADDRESS_WIDTH"])


def expected_response(word, *, writing):
    return DECERR if word >= WORDS else SLVERR if writing and word == WORDS - 1 else OKAY


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(stall=[0, 0.3, 0.8])
async def simultaneous_reads_and_writes(dut, stall):
    master = await start(dut, stall=stall)
    rng = random.Random(2)
    memory = bytearray(4 * WORDS)

    async def writes():
        # Writes go to the lower three words only, so that the other words' values are known to the reads.
        for _ in range(60):
            size = rng.choice([1, 2, 4])
            address = rng.randrange(0, 12, size)
            value = rng.getrandbits(8 * size)
            assert await write(master, address, value, size) == OKAY
            memory[address : address + size] = value.to_bytes(size, "little")

    async def reads():
        for _ in range(60):
            word = rng.randrange(3, SIZE // 4)
            assert await read(master, 4 * word) == (0, expected_response(word, writing=False))

    await gather(writes(), reads())
    for word in range(SIZE // 4):
        value = int.from_bytes(memory[4 * word : 4 * word + 4], "little")
        assert await read(master, 4 * word) == (value, expected_response(word, writing=False)), word
    for word in range(3, SIZE // 4):
        assert await write(master, 4 * word, 1) == expected_response(word, writing=True), word
        kept = int(word < WORDS - 1)
        assert await read(master, 4 * word) == (kept, expected_response(word, writing=False)), word


async def handshake(dut, channel, **payload):
    """Transfer one beat on an AXI4-Lite channel."""
    for name, value in payload.items():
        getattr(dut, f"axil__{name}").value = value
    valid = getattr(dut, f"axil__{channel}valid")
    valid.value = 1
    while True:
        await ReadOnly()
        taken = int(getattr(dut, f"axil__{channel}ready").value)
        await RisingEdge(dut.clk)
        if taken:
            break
    valid.value = 0


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(data_first=[False, True])
async def write_order_and_held_response(dut, data_first):
    await reset(dut)
    # The lowest two bits of the addresses are ignored.
    address = {"channel": "aw", "awaddr": 5}
    data = {"channel": "w", "wdata": 0x12345678, "wstrb": 0b1010}
    first, second = (data, address) if data_first else (address, data)
    await handshake(dut, **first)
    await ClockCycles(dut.clk, 10)
    assert not int(dut.axil__bvalid.value)
    await handshake(dut, **second)
    # A second write may be accepted, but takes effect only after the first one's response was taken.
    await handshake(dut, "aw", awaddr=7)
    await handshake(dut, "w", wdata=0xFFFFFFFF, wstrb=1)
    # A third one is offered meanwhile, and must not disturb the second.
    third = [
        cocotb.start_soon(handshake(dut, "aw", awaddr=10)),
        cocotb.start_soon(handshake(dut, "w", wdata=0x55AA33CC, wstrb=0b1111)),
    ]
    for _ in range(10):
        await RisingEdge(dut.clk)
        await ReadOnly()
        assert int(dut.axil__bvalid.value)
        assert int(dut.axil__bresp.value) == OKAY
    await RisingEdge(dut.clk)
    await handshake(dut, "ar", araddr=7)
    for value in (0x12005600, 0x120056FF):
        for _ in range(10):
            await RisingEdge(dut.clk)
            await ReadOnly()
            assert int(dut.axil__rvalid.value)
            assert int(dut.axil__rdata.value) == value
        await RisingEdge(dut.clk)
        dut.axil__bready.value = dut.axil__rready.value = 1
        await RisingEdge(dut.clk)
        dut.axil__bready.value = dut.axil__rready.value = 0
        await handshake(dut, "ar", araddr=7)
    await gather(*third)

    # Reads likewise: word 1 waits to be taken, word 2 is accepted, and word 0 is offered.
    await handshake(dut, "ar", araddr=9)
    fourth = cocotb.start_soon(handshake(dut, "ar", araddr=3))
    for value in (0x120056FF, 0x55AA33CC, 0):
        for _ in range(5):
            await RisingEdge(dut.clk)
            await ReadOnly()
            assert int(dut.axil__rvalid.value)
            assert int(dut.axil__rdata.value) == value
        await RisingEdge(dut.clk)
        dut.axil__rready.value = 1
        await RisingEdge(dut.clk)
        dut.axil__rready.value = 0
        await ClockCycles(dut.clk, 3)
    await fourth
