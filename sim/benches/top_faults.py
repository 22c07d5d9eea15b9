"""cocotb bench of the whole hardware when things go wrong, and of what a host can tell it to do.

Settings and frames, good or repaired, are in the folder BENCH, see sim/benches/top_run.py and
tests/gateware/test_top_zynq.py.
"""

import cocotb
from cocotb.triggers import RisingEdge

from fastac.sim.benches.top import SET
from fastac.sim.benches.top_run import (
    CAPTURE,
    COLUMNS,
    ENABLE,
    FRAME_BEATS,
    INTERRUPT,
    LINE_BEATS,
    STALLS,
    TEST,
    Run,
    beats,
    flags,
)


def line(frame: int, row: int, length: int, last: int, first: int) -> list[tuple[int, int, int]]:
    """`length` beats from a row of an image on, with or without an end of line and a start of frame."""
    begin = row * LINE_BEATS
    words = [word for word, *_ in beats(frame)][begin : begin + length]
    return [(word, last * (k == length - 1), first * (k == 0)) for k, word in enumerate(words)]


@cocotb.test(**TEST)
@cocotb.parametrize(scenario=list(SET["scenarios"]), stall=STALLS)
async def bad_input(dut, scenario, stall):
    """Repaired and marked, reported once, and the frames around it are as if nothing had been."""
    dut._log.info("scenario %s", scenario)
    run, scene = await Run.begin(dut, stall), SET["scenarios"][scenario]
    run.streams.beats += [beat for each in scene["lines"] for beat in line(*each)]
    await run.finish(scene["frames"], scene["bad"])
    await run.expect(FRAME_COUNT=len(scene["frames"]), FRAME_ERRORS=sum(scene["bad"]))
    errors = flags(*scene["errors"])
    await run.expect(ERRORS=errors)
    await run.host.write("ERRORS", ~errors & 0xFFFFFFFF)
    await run.expect(ERRORS=errors)
    await run.host.write("ERRORS", errors)
    await run.expect(ERRORS=0)


@cocotb.test(**TEST)
@cocotb.parametrize(
    kind=["hard", "soft"], cut=[1, FRAME_BEATS // 2, FRAME_BEATS - 1], closed=[False, True], stall=STALLS
)
async def reset_inside_a_frame(dut, kind, cut, closed, stall):
    """The output streams are inside a frame too; with `closed`, an offer may wait there."""
    run = await Run.begin(dut, stall, serve=False)
    run.streams.beats += beats(0, 1, 2, 3, 4)
    await run.taken(2 * FRAME_BEATS + cut)
    sinks = run.streams.sinks
    name = next((name for name in ("depth", "normals") if name in sinks), None)
    if name is not None:
        row = -(-COLUMNS[name] // SET["lanes"])
        enough = 5 * row + row // 2 if name == "depth" else 2 * FRAME_BEATS + 1
        await run.until(lambda: len(sinks[name].at) >= enough)
    run.streams.closed = closed
    if closed and name == "depth":
        await run.until(lambda: int(sinks[name].valid.value))
    await (run.hard_reset if kind == "hard" else run.soft_reset)()
    before = 0 if kind == "hard" else 2
    await run.expect(STATUS=0, FRAME_COUNT=before)
    for each in sinks:
        run.check(each, [0, 1, 2], [0, 0, 0], prefix=True)
    run.mark()
    await run.host.write("INTERRUPT_STATUS", 1)
    run.serve()
    run.streams.limit = len(run.streams.beats)
    await run.finish([3, 4])
    await run.expect(FRAME_COUNT=before + 2, FRAME_ERRORS=0)
    assert await run.host.read("ERRORS") & ~flags("result_overrun") == flags("no_start")


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def background_capture(dut, stall):
    """The frame after the one in which it is asked for; it outlives both resets."""
    captured, after = SET["captured"], SET["after_capture"]
    run = await Run.begin(dut, stall)
    run.streams.beats += beats(0, captured, *after)
    await run.taken(FRAME_BEATS // 2)
    await run.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    await run.expect(CONTROL=ENABLE | INTERRUPT | CAPTURE)
    run.streams.limit = len(run.streams.beats)
    await run.finish([0, captured, *after])
    await run.expect(CONTROL=ENABLE | INTERRUPT, ERRORS=0)
    for reset in (run.soft_reset, run.hard_reset):
        await reset()
        run.mark()
        run.streams.beats += beats(*after)
        run.streams.limit = len(run.streams.beats)
        await run.finish(after)
    # A reset inside such a frame leaves a torn background, and the request stands: the next frame heals it.
    run.mark()
    await run.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    run.streams.beats += beats(0)
    await run.taken(len(run.streams.taken_at) + FRAME_BEATS // 2)
    await run.until(lambda: int(dut.s_axis_tready.value))
    await run.soft_reset()
    await run.expect(CONTROL=ENABLE | INTERRUPT | CAPTURE)
    # And the next test: bring the bundle's background back.
    del run.streams.beats[len(run.streams.taken_at) :]
    run.mark()
    await run.host.write("CONTROL", ENABLE | INTERRUPT | CAPTURE)
    run.streams.beats += beats(SET["background"], 0)
    run.streams.limit = len(run.streams.beats)
    await run.finish([SET["background"], 0])


@cocotb.test(**TEST)
async def saturation_is_reported(dut):
    run = await Run.begin(dut)
    for frame, errors in SET["saturating"]:
        run.streams.beats += beats(frame)
        await run.finish([frame])
        await run.expect(ERRORS=flags(*errors))
        # A frame without leaves it as it is; one bit of two can be cleared.
        run.mark()
        run.streams.beats += beats(0)
        await run.finish([0])
        await run.expect(ERRORS=flags(*errors))
        for k, name in enumerate(errors):
            await run.host.write("ERRORS", flags(name))
            await run.expect(ERRORS=flags(*errors[k + 1 :]))
        run.mark()


@cocotb.test(**TEST)
async def interrupt_on_and_off(dut):
    run = await Run.begin(dut, serve=False)
    host = run.host
    await host.write("CONTROL", ENABLE)
    run.streams.beats += beats(0)
    await run.finish([0])
    await run.expect(INTERRUPT_STATUS=1, ERRORS=0)
    assert not int(dut.interrupt.value)
    await host.write("CONTROL", ENABLE | INTERRUPT)
    await RisingEdge(dut.clk)
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)
    await run.expect(INTERRUPT_STATUS=0)
    # Nobody acknowledges the next two.
    run.mark()
    run.streams.beats += beats(1, 0)
    await run.finish([1, 0])
    await run.expect(INTERRUPT_STATUS=1, ERRORS=flags("result_overrun"))
    assert int(dut.interrupt.value)
    await host.write("INTERRUPT_STATUS", 1)
    await host.write("ERRORS", 0xFF)
    await run.expect(INTERRUPT_STATUS=0, ERRORS=0)
    await RisingEdge(dut.clk)
    assert not int(dut.interrupt.value)


@cocotb.test(**TEST)
async def frames_are_dropped_while_disabled(dut):
    run = await Run.begin(dut)
    await run.host.write("CONTROL", INTERRUPT)
    run.streams.beats += beats(0, 1)
    await run.taken(2 * FRAME_BEATS - 1)
    # Enabled inside a frame: from the next one on.
    await run.host.write("CONTROL", ENABLE | INTERRUPT)
    run.streams.beats += beats(2)
    run.streams.limit = len(run.streams.beats)
    await run.finish([2])
    await run.expect(FRAME_COUNT=1, FRAME_ERRORS=0, ERRORS=0)
