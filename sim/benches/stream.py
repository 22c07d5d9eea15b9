"""cocotb testbench for components with one input and one output stream; used by `sim.check_stream.check`."""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

SETTINGS = json.loads(Path(os.environ["BENCH"]).read_text())
INPUTS, EXPECTED, MASKS = ([int(x, 16) for x in SETTINGS[key]] for key in ("inputs", "expected", "masks"))

LONGEST_PAUSE = 24
LINGER = 64
"""Clocks that show that nothing more happens."""
PATIENT = 0.5
"""With a larger share of pauses `o` is ready only once a beat waits: `valid` must not wait for `ready`."""


class Pauses:
    """Pauses of one side of a stream: `share` of all clocks, half of them one clock long, others bursts."""

    def __init__(self, share: float, rng: random.Random):
        self.share, self.rng, self.left = share, rng, 0
        mean = (1 + (2 + LONGEST_PAUSE) / 2) / 2
        self.begins = 1.0 if share >= 1 else share / (share + mean * (1 - share))

    def now(self) -> bool:
        """Whether this clock is part of a pause."""
        if not self.left and self.share and self.rng.random() < self.begins:
            self.left = 1 if self.rng.random() < 0.5 else self.rng.randint(2, LONGEST_PAUSE)
        paused = self.left > 0
        self.left -= paused
        return paused


@cocotb.test()
@cocotb.parametrize(stall=SETTINGS["stalls"])
async def values_order_latency_flags(dut, stall):
    noise = random.Random(f"{SETTINGS['seed']} noise")
    shares = stall if isinstance(stall, list) else [stall, stall]
    source, sink = (
        Pauses(share, random.Random(f"{SETTINGS['seed']} {side}"))
        for share, side in zip(shares, "io", strict=True)
    )
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    dut.rst.value = 1
    dut.i__valid.value = dut.o__ready.value = 0
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0

    offered, accepted_at, output_at, received = 0, [], [], []
    flags = dict.fromkeys(SETTINGS["flags"], 0)
    held = None  # what was offered at `o` and not taken
    idle = cycle = refused = 0
    full = SETTINGS["places"] is None or sink.share <= PATIENT
    needed, places = SETTINGS["places"] or (0, 0)
    # After the last expected beat no more may come.
    while idle < LINGER:
        assert cycle < SETTINGS["timeout_cycles"], (
            f"hang: {len(received)} of {len(EXPECTED)} after {cycle} cycles"
        )
        # A valid beat must not be withdrawn, so a pause is decided before the beat is offered.
        pauses = source.now() if full else offered == needed and held is None
        if offered == len(accepted_at) and not pauses and offered < len(INPUTS):
            dut.i__payload.value = INPUTS[offered]
            offered += 1
        dut.i__valid.value = int(offered > len(accepted_at))
        if offered == len(accepted_at):  # nobody may look at a payload that is not offered
            dut.i__payload.value = noise.getrandbits(len(dut.i__payload))
        pauses = sink.now()
        dut.o__ready.value = int(full and not pauses and (sink.share <= PATIENT or held is not None))
        await ReadOnly()
        inside = len(accepted_at) - len(received)
        if SETTINGS["room"] is not None:
            ready = int(dut.i__ready.value)
            assert ready == (inside < SETTINGS["room"]), (
                f"clock {cycle}: `i` ready: {ready}, beats inside: {inside}"
            )
        if int(dut.i__valid.value) and int(dut.i__ready.value):
            accepted_at.append(cycle)
            refused = 0
        else:
            refused += int(dut.i__valid.value) if accepted_at else 0  # before, a table may be written
        if not full and refused == LINGER:
            full = True
            assert len(accepted_at) == needed + places, (
                f"{len(accepted_at)} beats taken before the first one left, expected {needed + places}"
            )
        offer = int(dut.o__payload.value) if int(dut.o__valid.value) else None
        assert held in (None, offer), f"clock {cycle}: beat {len(received)} was withdrawn or changed at `o`"
        held = None if int(dut.o__ready.value) else offer
        if SETTINGS["elastic"]:
            ready = int(dut.i__ready.value)
            assert ready == (held is None), (
                f"clock {cycle}: `i` ready: {ready}, `o` waits: {held is not None}"
            )
        if int(dut.o__valid.value) and int(dut.o__ready.value):
            received.append(int(dut.o__payload.value))
            output_at.append(cycle)
            for flag in flags:
                flags[flag] += int(getattr(dut, flag).value)
        idle = idle + 1 if len(received) >= len(EXPECTED) and len(accepted_at) == len(INPUTS) else 0
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
    assert flags == SETTINGS["flags"], f"flags {flags}, expected {SETTINGS['flags']}"
    if not any(shares):
        measured = [[i, o, output_at[o] - accepted_at[i]] for i, o, _ in SETTINGS["latencies"]]
        assert measured == SETTINGS["latencies"], f"latencies {measured}, expected {SETTINGS['latencies']}"
