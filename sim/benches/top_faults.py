"""cocotb testbench of the top level: faulty input, resets inside frames, and the host's controls.

Settings and frames are in the folder BENCH, see top_testbench.py; tests/gateware/test_top_zynq.py makes them.
"""

import cocotb
from cocotb.triggers import RisingEdge

from fastac.sim.benches.top import SETTINGS
from fastac.sim.benches.top_testbench import (
    CAPTURE,
    COLUMNS,
    ENABLE,
    FRAME_BEATS,
    FRAMES,
    INTERRUPT,
    LINE_BEATS,
    STALLS,
    TEST,
    Testbench,
    error_bits,
    frame_beats_of,
)


def line(frame: int, row: int, length: int, last: int, first: int) -> list[tuple[int, int, int]]:
    """`length` beats from the start of a row on; `last`: with end of line; `first`: with start of frame."""
    begin = row * LINE_BEATS
    words = [word for word, *_ in frame_beats_of(frame)][begin : begin + length]
    return [(word, last * (k == length - 1), first * (k == 0)) for k, word in enumerate(words)]


@cocotb.test(**TEST)
@cocotb.parametrize(scenario=list(SETTINGS["scenarios"]), stall=STALLS)
async def bad_input(dut, scenario, stall):
    """A faulty frame is repaired, marked as bad and reported once; the frames around it are unchanged."""
    dut._log.info("scenario %s", scenario)
    bench, scene = await Testbench.start(dut, stall), SETTINGS["scenarios"][scenario]
    bench.streams.beats += [beat for each in scene["lines"] for beat in line(*each)]
    await bench.expect_frames(scene["frames"], scene["bad"])
    await bench.expect_registers(FRAME_COUNT=len(scene["frames"]), FRAME_ERRORS=sum(scene["bad"]))
    errors = error_bits(*scene["errors"])
    await bench.expect_registers(ERRORS=errors)
    await bench.host.write("ERRORS", ~errors & 0xFFFFFFFF)
    await bench.expect_registers(ERRORS=errors)
    await bench.host.write("ERRORS", errors)
    await bench.expect_registers(ERRORS=0)


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def camera_stops(dut, stall):
    """An abandoned frame is completed and marked as bad; its late beats change nothing."""
    bench, rows = await Testbench.start(dut, stall), FRAMES["frames"].shape[1]
    scene = SETTINGS["scenarios"]["frame_short"]
    begun, repaired = scene["lines"][rows : rows + SETTINGS["short_rows"]], scene["frames"][1]
    await bench.host.write("FRAME_TIMEOUT", 300)
    bench.streams.beats += frame_beats_of(0) + [beat for each in begun for beat in line(*each)]
    await bench.expect_frames([0, repaired], [0, 1])
    errors = error_bits(*(set(scene["errors"]) - {"frame_short"} | {"frame_timeout"}))
    await bench.expect_registers(FRAME_COUNT=2, FRAME_ERRORS=1, ERRORS=errors)
    bench.compare_from_here()
    bench.streams.beats += frame_beats_of(1)[len(begun) * LINE_BEATS :] + frame_beats_of(2)
    await bench.expect_frames([2])
    await bench.expect_registers(FRAME_COUNT=3, FRAME_ERRORS=1, ERRORS=errors)


@cocotb.test(**TEST)
@cocotb.parametrize(
    kind=["hard", "soft"], cut=[1, FRAME_BEATS // 2, FRAME_BEATS - 1], blocked=[False, True], stall=STALLS
)
async def reset_inside_a_frame(dut, kind, cut, blocked, stall):
    """Reset while one frame enters and another leaves; `blocked`: with a beat waiting at an output."""
    bench = await Testbench.start(dut, stall, serve_interrupts=False)
    bench.streams.beats += frame_beats_of(0, 1, 2, 3, 4)
    await bench.send_only(2 * FRAME_BEATS + cut)
    sinks = bench.streams.sinks
    name = next((name for name in ("depth", "normals") if name in sinks), None)
    if name is not None:
        row = -(-COLUMNS[name] // SETTINGS["lanes"])
        enough = 5 * row + row // 2 if name == "depth" else 2 * FRAME_BEATS + 1
        await bench.wait_until(lambda: len(sinks[name].cycles) >= enough)
    bench.streams.blocked = blocked
    if blocked and name == "depth":
        await bench.wait_until(lambda: int(sinks[name].valid.value))
    missing = {each: bench.beats_missing(each) for each in sinks}
    await (bench.hard_reset if kind == "hard" else bench.soft_reset)()
    before = 0 if kind == "hard" else 2
    await bench.expect_registers(STATUS=0, FRAME_COUNT=before)
    for each in sinks:
        closing = bench.check_stream(each, [0, 1, 2], [0, 0, 0], cut=kind)
        # A frame that was nearly complete may have ended while the host wrote.
        assert closing > 0 or kind == "hard" or missing[each] < 40
    bench.compare_from_here()
    await bench.host.write("INTERRUPT_STATUS", 1)
    bench.serve_interrupts()
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect_frames([3, 4])
    await bench.expect_registers(FRAME_COUNT=before + 2, FRAME_ERRORS=0)
    assert await bench.host.read("ERRORS") & ~error_bits("result_overrun") == error_bits("no_start")


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def background_capture(dut, stall):
    """The frame after the request becomes the background, which both kinds of reset keep."""
    captured, after = SETTINGS["captured"], SETTINGS["after_capture"]
    bench = await Testbench.start(dut, stall)
    bench.streams.beats += frame_beats_of(0, captured, *after)
    await bench.send_only(FRAME_BEATS // 2)
    await bench.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    await bench.expect_registers(CONTROL=ENABLE | INTERRUPT | CAPTURE)
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect_frames([0, captured, *after])
    await bench.expect_registers(CONTROL=ENABLE | INTERRUPT, ERRORS=0)
    for reset in (bench.soft_reset, bench.hard_reset):
        await reset()
        bench.compare_from_here()
        bench.streams.beats += frame_beats_of(*after)
        bench.streams.limit = len(bench.streams.beats)
        await bench.expect_frames(after)
    # A reset inside such a frame leaves a background of two frames; the request stays for the next frame.
    bench.compare_from_here()
    await bench.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    bench.streams.beats += frame_beats_of(0)
    await bench.send_only(len(bench.streams.accepted_at) + FRAME_BEATS // 2)
    await bench.wait_until(lambda: int(dut.s_axis_tready.value))
    await bench.soft_reset()
    await bench.expect_registers(CONTROL=ENABLE | INTERRUPT | CAPTURE)
    # Restore the bundle's background for the next test.
    del bench.streams.beats[len(bench.streams.accepted_at) :]
    bench.compare_from_here()
    await bench.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    bench.streams.beats += frame_beats_of(SETTINGS["background"], 0)
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect_frames([SETTINGS["background"], 0])


@cocotb.test(**TEST)
async def saturation_is_reported(dut):
    bench = await Testbench.start(dut)
    for frame, errors in SETTINGS["saturating"]:
        bench.streams.beats += frame_beats_of(frame)
        await bench.expect_frames([frame])
        await bench.expect_registers(ERRORS=error_bits(*errors))
        # A frame without saturation does not clear the flags; each can be cleared alone.
        bench.compare_from_here()
        bench.streams.beats += frame_beats_of(0)
        await bench.expect_frames([0])
        await bench.expect_registers(ERRORS=error_bits(*errors))
        for k, name in enumerate(errors):
            await bench.host.write("ERRORS", error_bits(name))
            await bench.expect_registers(ERRORS=error_bits(*errors[k + 1 :]))
        bench.compare_from_here()


@cocotb.test(**TEST)
async def interrupt_enable_and_acknowledge(dut):
    bench = await Testbench.start(dut, serve_interrupts=False)
    host = bench.host
    await host.write("CONTROL", ENABLE)
    bench.streams.beats += frame_beats_of(0)
    await bench.expect_frames([0])
    await bench.expect_registers(INTERRUPT_STATUS=1, ERRORS=0)
    assert not int(dut.interrupt.value)
    await host.write("CONTROL", ENABLE | INTERRUPT)
    await RisingEdge(dut.clk)
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)
    await bench.expect_registers(INTERRUPT_STATUS=0)
    # The next two results are not acknowledged.
    bench.compare_from_here()
    bench.streams.beats += frame_beats_of(1, 0)
    await bench.expect_frames([1, 0])
    await bench.expect_registers(INTERRUPT_STATUS=1, ERRORS=error_bits("result_overrun"))
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await host.write("ERRORS", 0xFF)
    await bench.expect_registers(INTERRUPT_STATUS=0, ERRORS=0)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)


@cocotb.test(**TEST)
async def frames_are_dropped_while_disabled(dut):
    bench = await Testbench.start(dut)
    await bench.host.write("CONTROL", INTERRUPT)
    bench.streams.beats += frame_beats_of(0, 1)
    await bench.send_only(2 * FRAME_BEATS - 1)
    # Enabled inside a frame: frames are accepted from the next one on.
    await bench.host.write("CONTROL", ENABLE | INTERRUPT)
    bench.streams.beats += frame_beats_of(2)
    bench.streams.limit = len(bench.streams.beats)
    await bench.expect_frames([2])
    await bench.expect_registers(FRAME_COUNT=1, FRAME_ERRORS=0, ERRORS=0)
