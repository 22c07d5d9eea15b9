"""cocotb testbench of BackgroundSubtraction: frames, some of which become the background.

Settings are in the file BENCH. `capture` is random in every clock after the first frame has begun; only its
value with the first accepted beat of a frame may count. The testbench records which frames were captured and
computes the expected features from that.
"""

import json
import os
import random
from itertools import pairwise
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

from fastac.models.integer.features import WIDTH
from fastac.sim.check_stream import pack

SETTINGS = json.loads(Path(os.environ["BENCH"]).read_text())
FRAMES, BACKGROUND = (np.array(SETTINGS[key]) for key in ("frames", "background"))  # (F, H, W, C), (H, W, C)
BEATS = BACKGROUND.shape[0] * BACKGROUND.shape[1] // SETTINGS["lanes"]  # of a frame


def features(background: np.ndarray, captured: list[int]) -> tuple[list[int], np.ndarray]:
    """Expected payloads if the frames marked in `captured` become the background, and the last background."""
    out = []
    for frame, own in zip(FRAMES, captured, strict=True):
        background = frame if own else background
        u = np.broadcast_to(np.array(SETTINGS["coordinate_u"]), frame.shape[:2])
        v = np.broadcast_to(np.array(SETTINGS["coordinate_v"])[:, None], frame.shape[:2])
        out.append(np.concatenate([frame - background, u[..., None], v[..., None]], axis=-1))
    return pack(np.array(out).reshape(len(FRAMES) * BEATS, -1), WIDTH), background


in_memory = [BACKGROUND]  # the memory's content, which the reset between two tests does not change


@cocotb.test()
@cocotb.parametrize(stall=SETTINGS["stalls"])
async def features_latency_capture(dut, stall):
    rng = random.Random(SETTINGS["seed"])
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    dut.rst.value = 1
    dut.i__valid.value = dut.o__ready.value = dut.capture.value = 0
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0

    inputs = pack(FRAMES.reshape(len(FRAMES) * BEATS, -1), 8)
    offered, accepted_at, output_at, received, captured = 0, [], [], [], []
    idle = cycle = 0
    # Go on for 64 clocks after the last expected beat: no more may come.
    while idle < 64:
        assert cycle < SETTINGS["timeout_cycles"], (
            f"hang: {len(received)} of {len(inputs)} after {cycle} cycles"
        )
        if offered == len(accepted_at) and offered < len(inputs) and rng.random() >= stall:
            dut.i__payload.value = inputs[offered]
            offered += 1
        dut.i__valid.value = int(offered > len(accepted_at))
        dut.o__ready.value = int(rng.random() >= stall)
        dut.capture.value = int(bool(accepted_at) and rng.random() < 0.5)
        await ReadOnly()
        frame, beat = divmod(len(accepted_at), BEATS)
        accepted = int(dut.i__valid.value) and int(dut.i__ready.value)
        if accepted and beat == 0:
            captured.append(int(dut.capture.value))
        done = int(accepted and beat == BEATS - 1 and captured[frame])
        assert int(dut.captured.value) == done, f"captured in cycle {cycle}: expected {done}"
        if accepted:
            accepted_at.append(cycle)
        if int(dut.o__valid.value) and int(dut.o__ready.value):
            received.append(int(dut.o__payload.value))
            output_at.append(cycle)
        idle = idle + 1 if len(received) >= len(inputs) else 0
        await RisingEdge(dut.clk)
        cycle += 1

    expected, background = features(in_memory[-1], captured)
    in_memory.append(background)
    # All four pairs of successive frames, captured or not, must occur.
    assert len(set(pairwise(captured))) == 4, f"captured {captured}: choose another seed"
    assert len(received) == len(expected), f"{len(received)} beats out, expected {len(expected)}"
    wrong = [k for k, (r, e) in enumerate(zip(received, expected, strict=True)) if r != e]
    assert not wrong, (
        f"{len(wrong)} of {len(expected)} beats differ, the first is beat {wrong[0]}:"
        f" {received[wrong[0]]:#x}, expected {expected[wrong[0]]:#x}"
    )
    if not stall:
        latencies = {left - accepted for left, accepted in zip(output_at, accepted_at, strict=True)}
        assert latencies == {SETTINGS["latency"]}, f"latencies {latencies}, expected {SETTINGS['latency']}"
