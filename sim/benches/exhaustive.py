"""cocotb testbench of a component without inputs that tries all cases by itself: waits until it is done.

Settings are in the environment: FOUND, the file for the component's counts, and CLOCKS, the most it may take.
"""

import json
import os
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, First, RisingEdge, Timer

PERIOD_NS = 2


@cocotb.test
async def all_cases(dut):
    Clock(dut.clk, PERIOD_NS, unit="ns").start()
    dut.rst.value = 1
    await ClockCycles(dut.clk, 2)
    dut.rst.value = 0
    await First(RisingEdge(dut.done), Timer(PERIOD_NS * int(os.environ["CLOCKS"]), "ns"))
    await ClockCycles(dut.clk, 2)
    assert int(dut.done.value), f"not done after {os.environ['CLOCKS']} clocks"
    found = {name: int(getattr(dut, name).value) for name in ("cases", "different")}
    Path(os.environ["FOUND"]).write_text(json.dumps(found))
