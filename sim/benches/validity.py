"""cocotb testbench of FrameValidity: frames without gaps, pauses of the pipeline, back-pressure on `verdict`.

Settings are in the file BENCH: the input words of each stage, the expected flags of each frame, the latency
of `verdict` in clocks, and the beats of pixels per frame. With `cases`, each (frame, word of limits in
hexadecimal, flags), the component has loadable limits and frames come one by one.

`measures` has for some stages the word of each frame's measures, `words`, and their `latency` in clocks from
the frame's last beat there.

With dots `dots_lags` has clocks from a frame's last beat of pixels to its last dot; frames that come one by
one take them in turn, others the first. `dots_latency` is the verdict's latency from the last dot.
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
PORT = {"slopes": "slopes_over", "displacements": "displacements_over", "dots": "dot_lost"}
TAKEN = {"dots": "dot_taken"}
DOTS_LAGS, DOTS_LATENCY = SETTINGS.get("dots_lags", [0]), SETTINGS.get("dots_latency", 0)
LAGS["dots"] = DOTS_LAGS[0]
MEASURES = SETTINGS.get("measures", {})
OBSERVED = [name for name in STREAMS if name != "dots"]


def schedule(name: str) -> dict[int, int]:
    """The input word of a stage in each clock in which it has a beat, if nothing pauses."""
    words = STREAMS[name]
    count = len(words) // len(FLAGS)
    return {LAGS[name] + (k // count + 1) * BEATS - count + k % count: word for k, word in enumerate(words)}


def drive(dut, name: str, moves: bool, word: int):
    getattr(dut, TAKEN.get(name, f"{name}_taken")).value = int(moves)
    getattr(dut, PORT.get(name, name)).value = word


async def start(dut):
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = 1
    for name in STREAMS:
        drive(dut, name, False, 0)
    await ClockCycles(dut.clk, 2)
    dut.rst.value = 0


@cocotb.test(timeout_time=1, timeout_unit="ms", skip="cases" in SETTINGS)
@cocotb.parametrize(pause=[0, 0.4], late=[0, 0.9])
async def flags_of_every_frame(dut, pause, late):
    """Every frame gets its own flags, in order and with the stated latency."""
    rng = random.Random(1)
    await start(dut)
    words = {name: schedule(name) for name in STREAMS}
    # Of the first frame's last beat at the last stage, and of its last dot: clock, and verdict's latency.
    last = [(LAGS[OBSERVED[-1]] + BEATS - 1, SETTINGS["latency"])]
    last += [(LAGS["dots"] + BEATS - 1, DOTS_LATENCY)] * ("dots" in STREAMS)
    due, offered, found, suspect = [[] for _ in last], [], [], []
    measured, measured_due = {name: [] for name in MEASURES}, {name: [] for name in MEASURES}
    clock = place = 0
    while len(found) < len(FLAGS):
        # All stages pause together, like one pipeline.
        moves = rng.random() >= pause
        for name, beats in words.items():
            anything = rng.choice(STREAMS[name])
            drive(dut, name, moves and place in beats, beats.get(place, anything) if moves else anything)
        if moves:
            for clocks, (end, latency) in zip(due, last, strict=True):
                if place >= end and (place - end) % BEATS == 0:
                    clocks.append(clock + latency)
            for name, clocks in measured_due.items():
                if place >= LAGS[name] and (place - LAGS[name]) % BEATS == BEATS - 1:
                    clocks.append(clock + MEASURES[name]["latency"])
            place += 1
        ready = rng.random() >= late
        dut.verdict__ready.value = int(ready)
        await ReadOnly()
        if int(dut.suspect_valid.value):
            suspect.append(int(dut.suspect.value))
        for name, seen in measured.items():
            if int(getattr(dut, f"{name}_measured").value):
                seen.append((clock, int(getattr(dut, f"{name}_measures").value)))
        if int(dut.verdict__valid.value):
            if len(offered) == len(found):
                offered.append(clock)
            if ready:
                found.append(int(dut.verdict__payload.value))
        await RisingEdge(dut.clk)
        clock += 1
    assert found == FLAGS, f"flags {found}, expected {FLAGS}"
    assert suspect[: len(FLAGS)] == [int(flags & ~OF_FORCE > 0) for flags in FLAGS]
    for name, seen in measured.items():
        words = MEASURES[name]["words"]
        expected = list(zip(measured_due[name], words, strict=False))
        assert seen[: len(words)] == expected, f"measures of {name}: {seen}, expected {expected}"
    if not late:
        expected = [max(clocks) for clocks in zip(*due, strict=False)][: len(FLAGS)]
        assert offered == expected, f"verdicts in clocks {offered}, expected {expected}"


@cocotb.test(timeout_time=1, timeout_unit="ms", skip="cases" not in SETTINGS)
async def flags_for_each_limit(dut):
    """A frame's flags follow the limits that are loaded, to the last bit of every measure."""
    await start(dut)
    dut.verdict__ready.value = 1
    for case, (frame, limits, expected) in enumerate(SETTINGS["cases"]):
        dut.limits.value = int(limits, 16)
        words, lags = {}, SHORT_LAGS | {"dots": DOTS_LAGS[case % len(DOTS_LAGS)]}
        for name, all_words in STREAMS.items():
            count = len(all_words) // SETTINGS["frames"]
            first = lags[name] + BEATS - count
            own = all_words[frame * count : (frame + 1) * count]
            words[name] = dict(enumerate(own, first))
        found, suspect = [], []
        for clock in range(2 * (max(lags.values()) + BEATS)):
            for name, beats in words.items():
                drive(dut, name, clock in beats, beats.get(clock, 0))
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
