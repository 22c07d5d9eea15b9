"""cocotb testbench of RegisterBlock: frames, results, interrupts and measured latencies."""

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge, gather

from fastac.models.integer.frame_validity import REASONS
from fastac.sim.benches.host import OKAY, read, start, write
from fastac.sim.benches.registers import (
    AT,
    FLAGS,
    IDENTITY,
    RESULT,
    any_bytes,
    bits,
    expect,
    frame,
    level,
    pack_forces,
    pulse,
)

LAST_PULSES = {f"{name}_done": 1 for name in ("depth", "normals") if getattr(IDENTITY, name)} | {RESULT: 1}
"""Inputs that pulse once for each frame whose results all leave in one clock."""


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def result_in_the_clock_of_a_soft_reset_is_discarded(dut):
    master = await start(dut)
    reset = bits("CONTROL", enable=1, soft_reset=1)
    done, clocks = cocotb.start_soon(write(master, AT["CONTROL"], reset)), 0
    while not await level(dut, "soft_reset"):
        clocks += 1
    assert await done == OKAY
    # Again, with a result in the clock of the soft reset, which is now known.
    await pulse(dut, frame_started=1)
    await RisingEdge(dut.clk)
    done = cocotb.start_soon(write(master, AT["CONTROL"], reset))
    await ClockCycles(dut.clk, clocks)
    names = {RESULT, "frame_done", "frame_bad"}
    spreads = ("spread", "touching") if IDENTITY.slip else ()
    for name in spreads:
        getattr(dut, name).value = 0xFFFFFFFF
    for name in names:
        getattr(dut, name).value = 1
    assert await level(dut, "soft_reset")
    for name in (*names, *spreads):
        getattr(dut, name).value = 0
    assert await done == OKAY
    await expect(master, INTERRUPT_STATUS=0, STATUS=0, ERRORS=0, FRAME_COUNT=0, FRAME_ERRORS=0)
    if spreads:
        await expect(master, SLIP_SPREAD=0, SLIP_DOTS=0)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frames_and_results(dut):
    master = await start(dut)
    limit = 1 << (IDENTITY.force_width - 1)
    forces = [[-limit, limit - 1, -5], [1, -1, limit - 1]]
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, interrupt_enable=1))

    await frame(dut, clocks=10)
    busy = bits("STATUS", busy=1, frames_in_flight=1)
    await expect(master, STATUS=busy, FRAME_COUNT=1, FRAME_ERRORS=0, INTERVAL=0)
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, soft_reset=1, interrupt_enable=1))
    await expect(master, STATUS=0, FRAME_COUNT=1)
    # Clocks after the first beat: the last beat at 20, the force at 52, the end of depth at 93.
    for k, bad in enumerate((1, 0)):
        assert not await level(dut, "interrupt")
        await frame(dut, clocks=20, bad=bad)
        await ClockCycles(dut.clk, 30)
        result = {RESULT: 1, "validity": FLAGS[k]}
        if IDENTITY.axes:
            result["force"] = pack_forces(forces[k][: len(IDENTITY.axes)])
        await pulse(dut, **result)
        if IDENTITY.axes and IDENTITY.depth:
            await ClockCycles(dut.clk, 40)
            await pulse(dut, depth_done=1)
        assert await level(dut, "interrupt")
        suspect = int(FLAGS[k] > 0)
        status = bits("STATUS", result_valid=1, last_frame_bad=bad, last_frame_suspect=suspect)
        await expect(master, STATUS=status, FRAME_COUNT=2 + k, FRAME_ERRORS=1, INTERRUPT_STATUS=1)
        # Flags without a result do not change those of the last result.
        await pulse(dut, validity=0xFF)
        errors = bits("ERRORS", frame_suspect=suspect)
        await expect(master, FRAME_VALIDITY=FLAGS[k], ERRORS=errors)
        await write(master, AT["ERRORS"], errors)
        if IDENTITY.axes:
            await expect(
                master,
                FORCE_SEQUENCE=2 + k,
                LATENCY_FIRST_PIXEL_TO_FORCE=52,
                LATENCY_LAST_PIXEL_TO_FORCE=32,
            )
            for axis, force in zip(IDENTITY.axes, forces[k], strict=False):
                await expect(master, **{f"FORCE_{axis.upper()}_LOW": force})
                await expect(master, **{f"FORCE_{axis.upper()}_HIGH": force >> 32})
        if IDENTITY.depth:
            await expect(master, LATENCY_FIRST_PIXEL_TO_DEPTH=93 if IDENTITY.axes else 52)
        await write(master, AT["INTERRUPT_STATUS"] + 1, 1, 1)
        await expect(master, INTERRUPT_STATUS=1)
        await write(master, AT["INTERRUPT_STATUS"], 1)
        await expect(master, INTERRUPT_STATUS=0, ERRORS=0)
    await write(master, AT["CONTROL"], bits("CONTROL", soft_reset=1))
    await expect(master, STATUS=0)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def each_flag_of_a_frame(dut):
    """Each alone; it stays until the next result, however many clocks later it is read."""
    master = await start(dut)
    flags = [1 << k for k in range(len(REASONS))]
    for value in (*flags, *(sum(flags) - flag for flag in flags), 0):
        await frame(dut, clocks=3)
        await pulse(dut, **LAST_PULSES, validity=value)
        await write(master, AT["INTERRUPT_STATUS"], 1)
        status = bits("STATUS", result_valid=1, last_frame_suspect=int(value > 0))
        await expect(master, STATUS=status, FRAME_VALIDITY=value)
        await RisingEdge(dut.clk)
        await expect(master, FRAME_VALIDITY=value, ERRORS=bits("ERRORS", frame_suspect=int(value > 0)))
        await write(master, AT["ERRORS"], 0xFFFFFFFF)
        await write(master, AT["CONTROL"], bits("CONTROL", enable=1, clear_results=1))


@cocotb.test(timeout_time=1, timeout_unit="ms", skip=not IDENTITY.slip)
async def spread_of_the_last_result(dut):
    """A frame slips if its spread is beyond the limit of now; without a result nothing is sampled."""
    master = await start(dut)
    limit, slips = IDENTITY.slip_limit, bits("STATUS", slip=1)
    known = bits("STATUS", result_valid=1)
    for touching, spread in ((3, limit), (100, limit + 1), (1 << 31, 1), (0xFFFFFFFF, 0xFFFFFFFF)):
        await frame(dut, clocks=3)
        await pulse(dut, **LAST_PULSES, spread=spread, touching=touching)
        await pulse(dut, spread=~spread & 0xFFFFFFFF, touching=5)
        found = {"SLIP_SPREAD": spread, "SLIP_DOTS": touching}
        await expect(master, **found, STATUS=known | slips * (spread > limit))
    # Another limit counts at once, for the frame that is known.
    await frame(dut, clocks=3)
    await pulse(dut, **LAST_PULSES, spread=0x80000000, touching=4)
    for value, slipping in ((0x80000000, 0), (0x7FFFFFFF, 1), (0, 1), (0xFFFFFFFF, 0)):
        assert await write(master, AT["SLIP_LIMIT"], value) == OKAY
        await expect(master, SLIP_LIMIT=value, STATUS=known | slips * slipping)
    await write(master, AT["ERRORS"], 0xFFFFFFFF)  # of results that nobody acknowledged
    async for value in any_bytes(master, "SLIP_LIMIT"):
        await expect(master, STATUS=known | slips * (value < 0x80000000))
    # A soft reset leaves the limit and the last frame's registers, as it does FRAME_VALIDITY.
    assert await write(master, AT["SLIP_LIMIT"], 7) == OKAY
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, soft_reset=1))
    await expect(master, SLIP_LIMIT=7, SLIP_SPREAD=0x80000000, SLIP_DOTS=4, STATUS=slips)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frames_in_flight_and_bad_frames_are_counted(dut):
    """The count of bad frames is set to what it would hold shortly before it wraps."""
    master = await start(dut)
    errors = 0xFFFFFFF8
    dut.frame_errors.value = errors
    in_flight = [1 << k for k in range(8)]
    for count in range(1, in_flight[-1] + 1):
        bad = count % 3 > 0
        errors = (errors + bad) & 0xFFFFFFFF
        await pulse(dut, frame_started=1)
        await pulse(dut, frame_done=1, frame_bad=int(bad))
        if count < 16 or count in in_flight:
            status = bits("STATUS", busy=1, frames_in_flight=count)
            await expect(master, FRAME_ERRORS=errors, STATUS=status)
    for _ in range(in_flight[-1]):
        await pulse(dut, **LAST_PULSES)
    await expect(master, STATUS=bits("STATUS", result_valid=1, last_frame_bad=int(bad)))


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def interrupt_and_overrun(dut):
    master = await start(dut)
    await frame(dut, clocks=5)
    await pulse(dut, **{RESULT: 1})
    await expect(master, INTERRUPT_STATUS=1, ERRORS=0)
    assert not await level(dut, "interrupt"), "not enabled"
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, interrupt_enable=1))
    assert await level(dut, "interrupt")
    # 12 clocks between the first beats; the second result overruns the first.
    await pulse(dut, accepted=1)
    await pulse(dut, frame_started=1)
    await ClockCycles(dut.clk, 7)
    await pulse(dut, accepted=1)
    await pulse(dut, frame_done=1)
    await RisingEdge(dut.clk)
    await frame(dut, clocks=5)
    await expect(master, INTERVAL=12)
    await pulse(dut, **{RESULT: 1})
    await expect(master, ERRORS=bits("ERRORS", result_overrun=1), INTERRUPT_STATUS=1)
    await write(master, AT["INTERRUPT_STATUS"], 1)
    assert not await level(dut, "interrupt")


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def result_in_the_clock_of_its_acknowledgement(dut):
    master = await start(dut)
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, interrupt_enable=1))
    # Measure how long an acknowledgement takes, then time a result to the clock in which one takes effect.
    await pulse(dut, **{RESULT: 1})
    acknowledging = cocotb.start_soon(write(master, AT["INTERRUPT_STATUS"], 1))
    clocks = 0
    while await level(dut, "interrupt"):
        clocks += 1
    await acknowledging
    await ClockCycles(dut.clk, 4)
    await pulse(dut, **{RESULT: 1})
    acknowledging = cocotb.start_soon(write(master, AT["INTERRUPT_STATUS"], 1))
    await ClockCycles(dut.clk, clocks - 1)
    await pulse(dut, **{RESULT: 1})
    await acknowledging
    await expect(master, INTERRUPT_STATUS=1, ERRORS=0)


@cocotb.test(timeout_time=1, timeout_unit="ms", skip=not IDENTITY.axes)
@cocotb.parametrize(stall=[0, 0.5])
async def both_halves_of_a_force_are_of_one_result(dut, stall):
    """The host reads both halves, and writes elsewhere, while results keep coming."""
    master = await start(dut, stall=stall)

    async def results():
        k = 0
        while True:
            # Both halves contain the number of the result; the sign alternates.
            k = (k + 1) % 127
            force = ~(k << 32 | k) if k % 2 else k << 32 | k
            await pulse(dut, **{RESULT: 1}, force=pack_forces([force] * len(IDENTITY.axes)))

    async def reads():
        for _ in range(40):
            for axis in IDENTITY.axes:
                low, _ = await read(master, AT[f"FORCE_{axis.upper()}_LOW"])
                high, _ = await read(master, AT[f"FORCE_{axis.upper()}_HIGH"])
                assert low == high, f"{high:#x} {low:#x}"

    async def writes():
        for k in range(40):
            assert await write(master, AT["CONTROL"], k % 2) == OKAY

    arriving = cocotb.start_soon(results())
    await gather(reads(), writes())
    arriving.cancel()
    getattr(dut, RESULT).value = 0
