"""cocotb testbench for pipelines between the streams `i` and `o`: only an output that waits stalls them."""

import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

CLOCKS = 400


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(stall=[0.5, 0.95])
async def moves_unless_the_output_waits(dut, stall):
    """`i` is ready in every clock in which `o` is empty or taken, and in no other."""
    rng = random.Random(3)
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    dut.rst.value = 1
    dut.i__valid.value = dut.o__ready.value = 0
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0
    offered, waited = False, 0
    for clock in range(CLOCKS):
        offered = offered or rng.random() < 0.9
        dut.i__valid.value = int(offered)
        dut.i__payload.value = 0
        dut.o__ready.value = int(rng.random() >= stall)
        await ReadOnly()
        waits = int(dut.o__valid.value) and not int(dut.o__ready.value)
        assert int(dut.i__ready.value) == (not waits), f"clock {clock}"
        offered, waited = bool(offered and waits), waited + waits
        await RisingEdge(dut.clk)
    assert waited, "the output never waited"
