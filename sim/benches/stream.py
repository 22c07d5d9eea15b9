"""cocotb bench of one input and one output stream; settings come from `sim.stream.check`."""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

SET = json.loads(Path(os.environ["BENCH"]).read_text())
INPUTS, EXPECTED, MASKS = ([int(x, 16) for x in SET[key]] for key in ("inputs", "expected", "masks"))


@cocotb.test()
@cocotb.parametrize(stall=SET["stalls"])
async def values_order_latency_flags(dut, stall):
    rng = random.Random(SET["seed"])
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    dut.rst.value = 1
    dut.i__valid.value = dut.o__ready.value = 0
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0

    offered, taken_at, left_at, received = 0, [], [], []
    flags = dict.fromkeys(SET["flags"], 0)
    idle = cycle = 0
    # After the last expected beat, linger: nothing more may come.
    while idle < 64:
        assert cycle < SET["timeout_cycles"], f"hang: {len(received)} of {len(EXPECTED)} after {cycle} cycles"
        # A stream may not withdraw what it has offered, so a stall is decided before the offer.
        if offered == len(taken_at) and offered < len(INPUTS) and rng.random() >= stall:
            dut.i__payload.value = INPUTS[offered]
            offered += 1
        dut.i__valid.value = int(offered > len(taken_at))
        dut.o__ready.value = int(rng.random() >= stall)
        await ReadOnly()
        if int(dut.i__valid.value) and int(dut.i__ready.value):
            taken_at.append(cycle)
        if int(dut.o__valid.value) and int(dut.o__ready.value):
            received.append(int(dut.o__payload.value))
            left_at.append(cycle)
            for flag in flags:
                flags[flag] += int(getattr(dut, flag).value)
        idle = idle + 1 if len(received) >= len(EXPECTED) and len(taken_at) == len(INPUTS) else 0
        await RisingEdge(dut.clk)
        cycle += 1

    assert len(received) == len(EXPECTED), f"{len(received)} beats out, expected {len(EXPECTED)}"
    wrong = [
        k for k, (r, e, m) in enumerate(zip(received, EXPECTED, MASKS, strict=True)) if (r & m) != (e & m)
    ]
    assert not wrong, (
        f"{len(wrong)} of {len(EXPECTED)} beats differ, the first is beat {wrong[0]}:"
        f" {received[wrong[0]]:#x}, expected {EXPECTED[wrong[0]]:#x}"
    )
    assert flags == SET["flags"], f"flags {flags}, expected {SET['flags']}"
    if not stall:
        measured = [[i, o, left_at[o] - taken_at[i]] for i, o, _ in SET["latencies"]]
        assert measured == SET["latencies"], f"latencies {measured}, expected {SET['latencies']}"
