"""cocotb testbench of FrameGuard: sequences of good and faulty beats, with random pauses on all sides.

Settings are in the file BENCH; tests/gateware/stream/test_frame_guard.py makes them with a golden model.
"""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from fastac.gateware.stream.frame_guard import FRAME_FAULTS, TIMEOUT_BITS

SETTINGS = json.loads(Path(os.environ["BENCH"]).read_text())
FLAGS = (*FRAME_FAULTS, "frame_started", "frame_done")


async def start(dut):
    cocotb.start_soon(Clock(dut.clk, 10, unit="ns").start())
    for signal in (dut.axis__tvalid, dut.o__ready, dut.tag__ready):
        signal.value = 0
    dut.enable.value, dut.hold.value, dut.timeout.value = 1, 0, SETTINGS["timeout"]
    await reset(dut)


async def reset(dut):
    dut.rst.value = 1
    for _ in range(2):
        await RisingEdge(dut.clk)
    dut.rst.value = 0


class SequenceRun:
    """Driver and monitors for one sequence of beats [tdata, tlast, tuser, enable], and what they record.

    At a None between beats the driver waits until an unfinished frame has been abandoned.

    stalls : probabilities per clock that the driver, `o` or `tag` pauses, and that `hold` is high; with 1
        `o` and `tag` pause until a beat waits
    """

    def __init__(self, dut, rng, stalls):
        self.dut, self.rng, self.stalls = dut, rng, stalls
        self.beats, self.tags, self.bad = [], [], []
        self.flags = dict.fromkeys(FLAGS, 0)
        self.accepted_at, self.output_at = [], []
        self.started_at, self.done_at = [], []

    async def play(self, beats):
        """Send `beats` and record all outputs until nothing has been valid for `linger` clocks."""
        dut, rng = self.dut, self.rng
        slow_in, slow_out, slow_tag, holds = self.stalls
        offered = idle = cycle = quiet = 0
        held, tag_waits = None, False
        pauses = {k - beats[:k].count(None) for k, beat in enumerate(beats) if beat is None}
        beats = [beat for beat in beats if beat]
        while idle < SETTINGS["linger"]:
            assert cycle < SETTINGS["timeout_cycles"], (
                f"hang: {len(self.accepted_at)} of {len(beats)} beats taken"
            )
            if quiet > SETTINGS["timeout"] + 10:
                pauses.discard(offered)
            taken = offered == len(self.accepted_at)
            pausing = taken and offered in pauses
            if taken and not pausing and offered < len(beats) and rng.random() >= slow_in:
                word, last, user, enable = beats[offered]
                dut.axis__tdata.value = word
                dut.axis__tlast.value, dut.axis__tuser.value = last, user
                dut.enable.value = enable
                offered += 1
            dut.axis__tvalid.value = int(offered > len(self.accepted_at))
            dut.o__ready.value = int(rng.random() >= slow_out or (slow_out == 1 and held is not None))
            dut.tag__ready.value = int(rng.random() >= slow_tag or (slow_tag == 1 and tag_waits))
            dut.hold.value = int(rng.random() < holds)
            await ReadOnly()
            waiting = (dut.axis__tvalid, dut.o__valid, dut.tag__valid)
            silent = not any(int(signal.value) for signal in waiting)
            idle = idle + 1 if silent and offered == len(beats) else 0
            if not (pausing and silent):
                quiet = 0
            elif not int(dut.hold.value):  # while `hold` is high, a frame may wait for its start
                quiet += 1
            took = int(dut.axis__tvalid.value) and int(dut.axis__tready.value)
            assert int(dut.accepted.value) == took
            if int(dut.frame_started.value):
                assert not int(dut.hold.value)
                # The beat that starts the frame is the last one accepted before: FrameTimer relies on it.
                assert beats[len(self.accepted_at) - 1][2]
            if took:
                self.accepted_at.append(cycle)
            tag_waits = int(dut.tag__valid.value) and not int(dut.tag__ready.value)
            if int(dut.tag__valid.value) and not tag_waits:
                # A frame's tag comes after its last beat and before the last beat of the next frame.
                frame = len(self.tags) + 1
                assert (
                    frame * SETTINGS["frame_beats"] <= len(self.beats) < (frame + 1) * SETTINGS["frame_beats"]
                )
                self.tags.append(int(dut.tag__payload.value))
            offer = (int(dut.o__valid.value), int(dut.o__payload.value))
            assert held in (None, offer), "an offer was changed or withdrawn"
            held = offer if offer[0] and not int(dut.o__ready.value) else None
            if offer[0] and int(dut.o__ready.value):
                self.beats.append(int(dut.o__payload.value))
                self.output_at.append(cycle)
            for flag in FLAGS:
                self.flags[flag] += int(getattr(dut, flag).value)
            if int(dut.frame_started.value):
                self.started_at.append(cycle)
            if int(dut.frame_done.value):
                self.bad.append(int(dut.frame_bad.value))
                self.done_at.append(cycle)
            await RisingEdge(dut.clk)
            cycle += 1


@cocotb.test()
@cocotb.parametrize(
    stalls=[(0, 0, 0, 0), (0.3, 0.3, 0.3, 0), (0, 0.8, 0.95, 0), (0.8, 0, 0.95, 0), (0, 1, 1, 0.9)]
)
async def outputs_of_every_sequence(dut, stalls):
    rng = random.Random(1)
    await start(dut)
    for sequence in SETTINGS["sequences"]:
        run = SequenceRun(dut, rng, stalls)
        await run.play([beat and (int(beat[0], 16), *beat[1:]) for beat in sequence["beats"]])
        name = sequence["name"]
        assert run.flags == sequence["flags"], f"{name}: flags {run.flags}, expected {sequence['flags']}"
        assert run.bad == run.tags == sequence["bad"], f"{name}: {run.bad}, {run.tags}, {sequence['bad']}"
        assert run.beats == [int(word, 16) for word in sequence["expected"]], f"{name}: pixels differ"
        if sequence["steady"] and not any(stalls):
            # Good frames: one beat per clock without gaps, and the stated latency.
            n = len(run.beats)
            assert run.accepted_at == list(range(run.accepted_at[0], run.accepted_at[0] + n))
            assert [o - i for i, o in zip(run.accepted_at, run.output_at, strict=True)] == [
                SETTINGS["latency"]
            ] * n
            first, last = (
                run.accepted_at[:: SETTINGS["frame_beats"]],
                run.accepted_at[SETTINGS["frame_beats"] - 1 : :],
            )
            assert run.started_at == [cycle + 1 for cycle in first]
            assert run.done_at == [cycle + 1 for cycle in last[:: SETTINGS["frame_beats"]]]
        await reset(dut)


async def clocks_until_timeout(dut, most):
    """Clocks from the call to the pulse; None if there is none within `most`."""
    for clock in range(most):
        await ReadOnly()
        if int(dut.frame_timeout.value):
            return clock
        await RisingEdge(dut.clk)
    return None


@cocotb.test()
@cocotb.parametrize(wait=[1, 10])
async def longest_timeout(dut, wait):
    """The clocks waited count to their largest value and stay there; the bench sets them close to it.

    wait : clocks until the timeout, too, is set to that value
    """
    most = (1 << TIMEOUT_BITS) - 1
    await start(dut)
    dut.o__ready.value = dut.tag__ready.value = 1
    dut.timeout.value = 0
    dut.axis__tlast.value, dut.axis__tuser.value, dut.axis__tvalid.value = 0, 1, 1
    await RisingEdge(dut.clk)
    dut.axis__tvalid.value = 0
    await ClockCycles(dut.clk, 5)
    dut.waited.value = most - 3
    await ClockCycles(dut.clk, wait)
    dut.timeout.value = most
    # The comparison has a clock of its own.
    assert await clocks_until_timeout(dut, 10) == max(4 - wait, 1)


@cocotb.test()
async def clocks_to_the_timeout(dut):
    """An unfinished frame waits `timeout` clocks, for ever with 0, and the value of the moment counts."""
    await start(dut)
    word = int(SETTINGS["sequences"][0]["beats"][0][0], 16)
    dut.o__ready.value = dut.tag__ready.value = 1

    for timeout in (1, 2, 7, 300):
        dut.timeout.value = timeout
        dut.axis__tdata.value, dut.axis__tlast.value, dut.axis__tuser.value = word, 0, 1
        dut.axis__tvalid.value = 1
        await RisingEdge(dut.clk)  # accepted in this clock
        dut.axis__tvalid.value = 0
        # In the next clock the beat is held; then come `timeout` clocks without one.
        assert await clocks_until_timeout(dut, 1000) == 1 + timeout
        await RisingEdge(dut.clk)
        for _ in range(2 * SETTINGS["frame_beats"]):
            await RisingEdge(dut.clk)
    dut.timeout.value = 0
    dut.axis__tvalid.value = 1
    await RisingEdge(dut.clk)
    dut.axis__tvalid.value = 0
    assert await clocks_until_timeout(dut, 1000) is None
    dut.timeout.value = 500
    assert await clocks_until_timeout(dut, 10) == 1
