"""cocotb testbench of FrameValidity: frames without gaps, pauses of the pipeline, back-pressure on `verdict`.

Settings are in the file BENCH: the input words of each stage, the expected flags of each frame, the latency
of `verdict` in clocks, and the beats of pixels per frame. With `cases`, each (frame, word of limits in
hexadecimal, flags), the component has loadable limits and frames come one by one.
"""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from fastac.models.integer.frame_validity import OF_FORCE

SETTINGS = json.loads(Path(os.environ["BENCH"]).read_text())
STREAMS, FLAGS, BEATS = SETTINGS["streams"], SETTINGS["flags"], SETTINGS["beats"]
LAGS = {"pixels": 0, "features": 3, "slopes": 40, "displacements": 300}
"""Clocks from a frame's last beat of pixels to its last beat at each stage: about the stages' latency."""
SHORT_LAGS = LAGS | {"slopes": 20, "displacements": 40}
"""For frames that come one by one."""
PORT = {"slopes": "slopes_over", "displacements": "displacements_over"}


def schedule(name: str) -> dict[int, int]:
    """The input word of a stage in each clock in which it has a beat, if nothing pauses."""
    words = STREAMS[name]
    count = len(words) // len(FLAGS)
    return {LAGS[name] + (k // count + 1) * BEATS - count + k % count: word for k, word in enumerate(words)}


async def start(dut):
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for name in STREAMS:
        getattr(dut, f"{name}_taken").value = 0
    await ClockCycles(dut.clk, 2)
    dut.rst.value = 0


@cocotb.test(timeout_time=1, timeout_unit="ms", skip="cases" in SETTINGS)
@cocotb.parametrize(pause=[0, 0.4], late=[0, 0.9])
async def flags_of_every_frame(dut, pause, late):
    """Every frame gets its own flags, in order and with the stated latency."""
    rng = random.Random(1)
    await start(dut)
    words = {name: schedule(name) for name in STREAMS}
    last = LAGS[list(STREAMS)[-1]] + BEATS - 1  # clock of a frame's last beat at the last stage
    ends, offered, found, suspect = [], [], [], []
    clock = place = 0
    while len(found) < len(FLAGS):
        # All stages pause together, like one pipeline.
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
    assert suspect[: len(FLAGS)] == [int(flags & ~OF_FORCE > 0) for flags in FLAGS]
    if not late:
        found = [b - a for a, b in zip(ends, offered, strict=False)]
        assert found == [SETTINGS["latency"]] * len(FLAGS), f"clocks {found}, expected {SETTINGS['latency']}"


@cocotb.test(timeout_time=1, timeout_unit="ms", skip="cases" not in SETTINGS)
async def flags_for_each_limit(dut):
    """A frame's flags follow the limits that are loaded, to the last bit of every measure."""
    await start(dut)
    dut.verdict__ready.value = 1
    for frame, limits, expected in SETTINGS["cases"]:
        dut.limits.value = int(limits, 16)
        words = {}
        for name, all_words in STREAMS.items():
            count = len(all_words) // SETTINGS["frames"]
            first = SHORT_LAGS[name] + BEATS - count
            own = all_words[frame * count : (frame + 1) * count]
            words[name] = dict(enumerate(own, first))
        found, suspect = [], []
        for clock in range(2 * (max(SHORT_LAGS.values()) + BEATS)):
            for name, beats in words.items():
                getattr(dut, f"{name}_taken").value = int(clock in beats)
                getattr(dut, PORT.get(name, name)).value = beats.get(clock, 0)
            await ReadOnly()
            if int(dut.suspect_valid.value):
                suspect.append(int(dut.suspect.value))
            if int(dut.verdict__valid.value):
                found.append(int(dut.verdict__payload.value))
            await RisingEdge(dut.clk)
            if found:
                break
        assert found == [expected], f"frame {frame}, limits {limits}: flags {found}, expected {expected}"
        assert suspect == [int(expected & ~OF_FORCE > 0)]
