"""AXI4-Lite accesses from a cocotb bench, with pauses on every channel."""

import random
from collections.abc import Iterator

from cocotb.clock import Clock
from cocotb.triggers import RisingEdge
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

OKAY, SLVERR, DECERR = 0, 2, 3


async def reset(dut) -> None:
    """Start the clock and reset `dut`."""
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for _ in range(3):
        await RisingEdge(dut.clk)
    dut.rst.value = 0
    await RisingEdge(dut.clk)


def pauses(stall: float, seed: int) -> Iterator[bool]:
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
    """The word at `address` and the response."""
    result = await master.read(address, 4)
    return int.from_bytes(result.data, "little"), int(result.resp)


async def write(master: AxiLiteMaster, address: int, value: int, size: int = 4) -> int:
    """Write the `size` low bytes of `value` from `address` on; the other bytes are not strobed."""
    result = await master.write(address, value.to_bytes(size, "little"))
    return int(result.resp)
