"""cocotb bench of the frames' flags: frames without a gap, streams that pause, verdicts that are taken late.

Settings are in the file BENCH: the words that each stream takes, the flags of each frame, the clocks that a
verdict takes, and how many beats of the pixels are a frame.
"""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from fastac.models.integer.frame_validity import DISPLACEMENT

SET = json.loads(Path(os.environ["BENCH"]).read_text())
STREAMS, FLAGS, BEATS = SET["streams"], SET["flags"], SET["beats"]
LAGS = {"pixels": 0, "features": 3, "slopes": 40, "displacements": 300}
"""Clocks by which a frame's last beat follows that of its pixels: about what the stages between take."""
PORT = {"slopes": "slopes_over", "displacements": "displacements_over"}


def schedule(name: str) -> dict[int, int]:
    """The word of each clock in which a stream moves, if nothing pauses."""
    words = STREAMS[name]
    count = len(words) // len(FLAGS)
    return {LAGS[name] + (k // count + 1) * BEATS - count + k % count: word for k, word in enumerate(words)}


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(pause=[0, 0.4], late=[0, 0.9])
async def flags_of_every_frame(dut, pause, late):
    """Each is of its own frame, and on time."""
    rng = random.Random(1)
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for name in STREAMS:
        getattr(dut, f"{name}_taken").value = 0
    await ClockCycles(dut.clk, 2)
    dut.rst.value = 0
    words = {name: schedule(name) for name in STREAMS}
    last = LAGS[list(STREAMS)[-1]] + BEATS - 1  # of a frame's last stream, its last beat
    ends, offered, found, suspect = [], [], [], []
    clock = place = 0
    while len(found) < len(FLAGS):
        # All streams stand still together, as one pipeline does.
        moves = rng.random() >= pause
        for name, beats in words.items():
            getattr(dut, f"{name}_taken").value = int(moves and place in beats)
            anything = rng.choice(STREAMS[name])
            getattr(dut, PORT.get(name, name)).value = beats.get(place, anything) if moves else anything
        if moves:
            if place >= last and (place - last) % BEATS == 0:
                ends.append(clock)
            place += 1
        ready = rng.random() >= late
        dut.verdict__ready.value = int(ready)
        await ReadOnly()
        if int(dut.suspect_valid.value):
            suspect.append(int(dut.suspect.value))
        if int(dut.verdict__valid.value):
            if len(offered) == len(found):
                offered.append(clock)
            if ready:
                found.append(int(dut.verdict__payload.value))
        await RisingEdge(dut.clk)
        clock += 1
    assert found == FLAGS, f"flags {found}, expected {FLAGS}"
    assert suspect[: len(FLAGS)] == [int(flags & ~DISPLACEMENT > 0) for flags in FLAGS]
    if not late:
        found = [b - a for a, b in zip(ends, offered, strict=False)]
        assert found == [SET["latency"]] * len(FLAGS), f"clocks {found}, expected {SET['latency']}"
