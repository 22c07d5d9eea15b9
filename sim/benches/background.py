"""cocotb bench of the background subtraction: frames, some of which become the background.

Settings come from its test. `capture` is random in every cycle after the first frame has begun, so that only
its value with the first accepted beat of a frame may count; which frames it captured is noted here and the
expected features follow from that.
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

SET = json.loads(Path(os.environ["BENCH"]).read_text())
FRAMES, BACKGROUND = (np.array(SET[key]) for key in ("frames", "background"))  # (F, H, W, C), (H, W, C)
BEATS = BACKGROUND.shape[0] * BACKGROUND.shape[1] // SET["lanes"]  # of a frame


def features(background: np.ndarray, captured: list[int]) -> tuple[list[int], np.ndarray]:
    """The payloads that must leave if the frames marked in `captured` become the background, and the last."""
    out = []
    for frame, own in zip(FRAMES, captured, strict=True):
        background = frame if own else background
        u = np.broadcast_to(np.array(SET["coordinate_u"]), frame.shape[:2])
        v = np.broadcast_to(np.array(SET["coordinate_v"])[:, None], frame.shape[:2])
        out.append(np.concatenate([frame - background, u[..., None], v[..., None]], axis=-1))
    return pack(np.array(out).reshape(len(FRAMES) * BEATS, -1), WIDTH), background


in_memory = [BACKGROUND]  # what the memory holds outlives the reset between two tests


@cocotb.test()
@cocotb.parametrize(stall=SET["stalls"])
async def features_latency_capture(dut, stall):
    rng = random.Random(SET["seed"])
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    dut.rst.value = 1
    dut.i__valid.value = dut.o__ready.value = dut.capture.value = 0
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0

    inputs = pack(FRAMES.reshape(len(FRAMES) * BEATS, -1), 8)
    offered, taken_at, left_at, received, captured = 0, [], [], [], []
    idle = cycle = 0
    # After the last expected beat, linger: nothing more may come.
    while idle < 64:
        assert cycle < SET["timeout_cycles"], f"hang: {len(received)} of {len(inputs)} after {cycle} cycles"
        if offered == len(taken_at) and offered < len(inputs) and rng.random() >= stall:
            dut.i__payload.value = inputs[offered]
            offered += 1
        dut.i__valid.value = int(offered > len(taken_at))
        dut.o__ready.value = int(rng.random() >= stall)
        dut.capture.value = int(bool(taken_at) and rng.random() < 0.5)
        await ReadOnly()
        frame, beat = divmod(len(taken_at), BEATS)
        accepted = int(dut.i__valid.value) and int(dut.i__ready.value)
        if accepted and beat == 0:
            captured.append(int(dut.capture.value))
        done = int(accepted and beat == BEATS - 1 and captured[frame])
        assert int(dut.captured.value) == done, f"captured in cycle {cycle}: expected {done}"
        if accepted:
            taken_at.append(cycle)
        if int(dut.o__valid.value) and int(dut.o__ready.value):
            received.append(int(dut.o__payload.value))
            left_at.append(cycle)
        idle = idle + 1 if len(received) >= len(inputs) else 0
        await RisingEdge(dut.clk)
        cycle += 1

    expected, background = features(in_memory[-1], captured)
    in_memory.append(background)
    # Each of the four successions of captured and other frames must occur.
    assert len(set(pairwise(captured))) == 4, f"captured {captured}: choose another seed"
    assert len(received) == len(expected), f"{len(received)} beats out, expected {len(expected)}"
    wrong = [k for k, (r, e) in enumerate(zip(received, expected, strict=True)) if r != e]
    assert not wrong, (
        f"{len(wrong)} of {len(expected)} beats differ, the first is beat {wrong[0]}:"
        f" {received[wrong[0]]:#x}, expected {expected[wrong[0]]:#x}"
    )
    if not stall:
        latencies = {left - taken for left, taken in zip(left_at, taken_at, strict=True)}
        assert latencies == {SET["latency"]}, f"latencies {latencies}, expected {SET['latency']}"
