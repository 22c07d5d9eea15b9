"""AXI4-Lite master for cocotb testbenches: reset, read and write, with random pauses on every channel."""

import random
from collections.abc import Iterator

from cocotb.clock import Clock
from cocotb.triggers import RisingEdge
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

OKAY, SLVERR, DECERR = 0, 2, 3
"""AXI response codes."""


async def reset(dut) -> None:
    """Start the clock and reset `dut`."""
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for _ in range(3):
        await RisingEdge(dut.clk)
    dut.rst.value = 0
    await RisingEdge(dut.clk)


def pauses(stall: float, seed: int) -> Iterator[bool]:
    """Whether to pause in each clock: True with probability `stall`."""
    rng = random.Random(seed)
    while True:
        yield rng.random() < stall


async def start(dut, *, stall: float = 0, seed: int = 1) -> AxiLiteMaster:
    """Reset `dut` and attach a master to its `axil`; each channel pauses with probability `stall`."""
    master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "axil_"), dut.clk, dut.rst)
    write, read = master.write_if, master.read_if
    channels = (write.aw_channel, write.w_channel, write.b_channel, read.ar_channel, read.r_channel)
    for k, channel in enumerate(channels if stall else ()):
        channel.set_pause_generator(pauses(stall, seed + k))
    await reset(dut)
    return master


async def read(master: AxiLiteMaster, address: int) -> tuple[int, int]:
    """Read 32 bits at `address`; returns (value, response)."""
    result = await master.read(address, 4)
    return int.from_bytes(result.data, "little"), int(result.resp)


async def write(master: AxiLiteMaster, address: int, value: int, size: int = 4) -> int:
    """Write the `size` low bytes of `value` to `address` with just their strobes; returns the response."""
    result = await master.write(address, value.to_bytes(size, "little"))
    return int(result.resp)
