"""cocotb testbench of FrameTimer: random overlapping frames, all outputs compared in every clock.

No simulation lasts until 32-bit counters wrap: now and then the bench sets the clock to what it would hold
after any number of clocks, and the frames' counter begins with the value in the variable FRAME_COUNT. The
variable RESULTS names the kinds of results, the first of which is the one with a number and a last beat; with
PACKETS the bench gives the time, of 64 bits, and with STAMPS the last whole frame's stamp is compared, too.
"""

import os
import random
from collections import deque

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

RESULTS = tuple(os.environ["RESULTS"].split(","))
PACKETS, STAMPS = (os.environ[name] == "True" for name in ("PACKETS", "STAMPS"))
PULSES = {name: "result_valid" if name == "force" else f"{name}_done" for name in RESULTS}
INPUTS = ("accepted", "frame_started", "frame_done", "frame_bad", "flush", *PULSES.values())
NUMBERED = RESULTS[0] if PACKETS or RESULTS[0] == "force" else None
"""The kind of result that has a number and a last beat."""
WRAP = 1 << 32
TIME_BITS = 64 if PACKETS else 32
FRAMES = 8
"""Frames in flight whose times are right."""


def late(rng):
    """A clock, often shortly before a carry into one of its upper bits."""
    return rng.choice((rng.getrandbits(TIME_BITS), (1 << rng.randint(2, TIME_BITS)) - rng.randint(1, 3)))


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(
    (("most", "hurry"), [(FRAMES, (0.05,)), (FRAMES, (0.5,)), (FRAMES, (0.95,)), (250, (0, 0.05, 1))])
)
async def overlapping_frames(dut, most, hurry):
    """most, hurry : frames in flight; probabilities per clock that a result leaves when it may"""
    rng = random.Random(1)
    Clock(dut.clk, 10, unit="ns").start()
    for name in INPUTS:
        getattr(dut, name).value = 0
    dut.rst.value = 1
    await RisingEdge(dut.clk)
    await RisingEdge(dut.clk)
    dut.rst.value = 0

    frames, ended, now = int(os.environ["FRAME_COUNT"]), 0, 0
    open_frame, previous_first, accepted_at = None, None, None
    waiting = {name: deque() for name in RESULTS}
    expected = {"frame_count": frames, "in_flight": 0, "interval": 0}
    stamp = None  # of the last whole frame: number, mark, time, from the lowest bit on
    for cycle in range(4000):
        if cycle % 300 == 0:
            leave = {name: rng.choice(hurry) for name in RESULTS}
            leave[RESULTS[0]] *= 0.5
        pulses = dict.fromkeys(INPUTS, 0)
        # The first one tells the results' counters where the frames' counter begins.
        flush = pulses["flush"] = int(cycle == 0 or rng.random() < 0.016 / most)
        if rng.random() < 0.02:
            now = late(rng)
            if not PACKETS:
                dut.now.value = now
        if PACKETS:
            dut.time.value = now
        pulses["accepted"] = int(rng.random() < 0.6)
        kind = None
        full = max(map(len, waiting.values())) >= most
        if accepted_at is not None and rng.random() < (0.3 if most == FRAMES else 0.9):
            if open_frame is None and not full:
                kind = "frame_started"
            elif open_frame is not None:
                kind = "frame_done"
        if kind:
            pulses[kind] = 1
        pulses["frame_bad"] = rng.getrandbits(1)
        leaving = {name: int(bool(queue) and rng.random() < leave[name]) for name, queue in waiting.items()}
        pulses |= {PULSES[name]: left for name, left in leaving.items()}
        for name, value in pulses.items():
            getattr(dut, name).value = value

        await ReadOnly()
        for name, value in expected.items():
            assert int(getattr(dut, name).value) == value, f"clock {cycle}: {name}"
        if STAMPS and stamp is not None:
            assert int(dut.stamp.value) == stamp, f"clock {cycle}: stamp"

        # The outputs expected from the next clock on.
        if flush:
            open_frame = previous_first = None
            for queue in waiting.values():
                queue.clear()
        else:
            for name, queue in waiting.items():
                if leaving[name]:
                    number, first, last, bad = queue.popleft()
                    if most == FRAMES:
                        expected |= {f"first_to_{name}": (now - first) % WRAP, f"{name}_bad": bad}
                    if name == NUMBERED:
                        expected[f"{name}_number"] = number
                    if name == NUMBERED and most == FRAMES:
                        expected[f"last_to_{name}"] = (now - last) % WRAP
                    if PACKETS and name == NUMBERED and most == FRAMES:
                        expected["result_time"] = first
            if kind == "frame_started":
                open_frame = accepted_at
                if previous_first is not None:
                    expected["interval"] = (accepted_at - previous_first) % WRAP
                previous_first = accepted_at
            if kind == "frame_done":
                frames, ended = (frames + 1) % WRAP, ended + 1
                for queue in waiting.values():
                    queue.append((frames, open_frame, accepted_at, pulses["frame_bad"]))
                stamp = frames | pulses["frame_bad"] << 32 | open_frame << 33
                open_frame = None
        expected["frame_count"] = frames
        expected["in_flight"] = max(map(len, waiting.values())) + (open_frame is not None)
        if pulses["accepted"]:
            accepted_at = now
        now = (now + 1) % (1 << TIME_BITS)
        await RisingEdge(dut.clk)
    assert ended > 20
