"""cocotb testbench of FrameTimer: random overlapping frames, all outputs compared in every clock."""

import random
from collections import deque

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

INPUTS = ("accepted", "frame_started", "frame_done", "frame_bad", "flush", "result_valid", "depth_done")


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(hurry=[0.05, 0.5, 0.95])
async def overlapping_frames(dut, hurry):
    """hurry : probability per clock that a result leaves when it may"""
    rng = random.Random(1)
    Clock(dut.clk, 10, unit="ns").start()
    for name in INPUTS:
        getattr(dut, name).value = 0
    dut.rst.value = 1
    await RisingEdge(dut.clk)
    await RisingEdge(dut.clk)
    dut.rst.value = 0

    frames = 0
    open_frame, previous_first, accepted_at = None, None, None
    waiting = {"force": deque(), "depth": deque()}
    expected = {"frame_count": 0, "in_flight": 0, "interval": 0}
    for cycle in range(4000):
        pulses = dict.fromkeys(INPUTS, 0)
        flush = pulses["flush"] = int(rng.random() < 0.002)
        pulses["accepted"] = int(rng.random() < 0.6)
        kind = None
        full = max(map(len, waiting.values())) >= 7
        if accepted_at is not None and rng.random() < 0.3:
            if open_frame is None and not full:
                kind = "frame_started"
            elif open_frame is not None:
                kind = "frame_done"
        if kind:
            pulses[kind] = 1
        pulses["frame_bad"] = rng.getrandbits(1)
        leaving = {
            name: int(bool(queue) and rng.random() < hurry * (0.5 if name == "force" else 1))
            for name, queue in waiting.items()
        }
        pulses["result_valid"], pulses["depth_done"] = leaving["force"], leaving["depth"]
        for name, value in pulses.items():
            getattr(dut, name).value = value

        await ReadOnly()
        for name, value in expected.items():
            assert int(getattr(dut, name).value) == value, f"clock {cycle}: {name}"

        # The outputs expected from the next clock on.
        if flush:
            open_frame = previous_first = None
            for queue in waiting.values():
                queue.clear()
        else:
            for name, queue in waiting.items():
                if leaving[name]:
                    number, first, last, bad = queue.popleft()
                    expected |= {f"first_to_{name}": cycle - first, f"{name}_bad": bad}
                    if name == "force":
                        expected |= {"last_to_force": cycle - last, "force_number": number}
            if kind == "frame_started":
                open_frame = accepted_at
                if previous_first is not None:
                    expected["interval"] = accepted_at - previous_first
                previous_first = accepted_at
            if kind == "frame_done":
                frames += 1
                for queue in waiting.values():
                    queue.append((frames, open_frame, accepted_at, pulses["frame_bad"]))
                open_frame = None
        expected["frame_count"] = frames
        expected["in_flight"] = max(map(len, waiting.values())) + (open_frame is not None)
        if pulses["accepted"]:
            accepted_at = cycle
        await RisingEdge(dut.clk)
    assert frames > 20
