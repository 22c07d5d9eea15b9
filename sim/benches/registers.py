"""cocotb bench of the register block: every register, every address, and what sets and clears them."""

import json
import os

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge, gather

from fastac.gateware.bus.register_map import ERRORS, REGISTERS, Identity
from fastac.sim.benches.host import DECERR, OKAY, SLVERR, read, start, write

IDENTITY = Identity(**json.loads(os.environ["IDENTITY"]))
AT = {register.name: register.offset for register in IDENTITY.registers}
FIELDS = {register.name: {field.name: field for field in register.fields} for register in REGISTERS}
FLAGS = (0x155, 0)
RESULT = "result_valid" if IDENTITY.axes else "depth_done"


def bits(register, **values):
    """The word of a register from its fields."""
    return sum(value << FIELDS[register][name].low for name, value in values.items())


async def expect(master, **values):
    for name, value in values.items():
        found = await read(master, AT[name])
        assert found == (value & 0xFFFFFFFF, OKAY), f"{name}: {found}, expected {value:#x}"


async def pulse(dut, **values):
    """Drive the named inputs for one clock."""
    for name, value in values.items():
        getattr(dut, name).value = value
    await RisingEdge(dut.clk)
    for name in values:
        getattr(dut, name).value = 0


async def frame(dut, *, clocks, bad=0):
    """A frame whose first beat is accepted now and whose last one `clocks` later."""
    await pulse(dut, accepted=1)
    await pulse(dut, frame_started=1)
    await ClockCycles(dut.clk, clocks - 2)
    await pulse(dut, accepted=1)
    await pulse(dut, frame_done=1, frame_bad=bad)


async def level(dut, name):
    """What an output is in this clock; the next one follows."""
    await ReadOnly()
    value = int(getattr(dut, name).value)
    await RisingEdge(dut.clk)
    return value


def pack(forces):
    width = IDENTITY.force_width
    return sum((force & ((1 << width) - 1)) << (k * width) for k, force in enumerate(forces))


@cocotb.test(timeout_time=1, timeout_unit="ms")
@cocotb.parametrize(stall=[0, 0.6])
async def every_address_after_reset(dut, stall):
    master = await start(dut, stall=stall)
    values = dict.fromkeys(AT, 0)
    values |= {
        "ID": int.from_bytes(b"FTAC", "big"),
        "VERSION": IDENTITY.version,
        "BUNDLE_HASH_LOW": IDENTITY.bundle_hash & 0xFFFFFFFF,
        "BUNDLE_HASH_HIGH": IDENTITY.bundle_hash >> 32,
        "GEOMETRY": bits("GEOMETRY", height=IDENTITY.height, width=IDENTITY.width),
        "CONTROL": bits("CONTROL", enable=1),
    }
    counts = {name: getattr(IDENTITY, name) for name in ("channels", "lanes")}
    outputs = ("depth", "background_capture", "normals", "force_map", "rows_reversed")
    counts |= {name: int(getattr(IDENTITY, name)) for name in outputs}
    counts |= {f"force_{axis}": int(axis in IDENTITY.axes) for axis in "xyz"}
    values["CAPABILITIES"] = bits("CAPABILITIES", **counts)
    if IDENTITY.calibration:
        dut.calibration__bundle_hash.value = IDENTITY.bundle_hash
        values["CALIBRATION_WORDS"] = IDENTITY.calibration_words
        values["CALIBRATION_LAYOUT"] = IDENTITY.calibration_layout
        values["CAPABILITIES"] |= bits("CAPABILITIES", calibration=1)
    await expect(master, **values)
    registers = {register.offset: register for register in IDENTITY.registers}
    for address in range(0, 256, 4):
        if address not in registers:
            assert await read(master, address) == (0, DECERR), hex(address)
            assert await write(master, address, 0xFFFFFFFF) == DECERR, hex(address)
        elif registers[address].access == "ro":
            assert await write(master, address, 0xFFFFFFFF) == SLVERR, registers[address].name
    await expect(master, **values)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def control(dut):
    master = await start(dut)
    assert await level(dut, "enable")
    resets = 0

    async def count_resets():
        nonlocal resets
        while True:
            await ReadOnly()
            resets += int(dut.soft_reset.value)
            await RisingEdge(dut.clk)

    counting = cocotb.start_soon(count_resets())
    everything = bits("CONTROL", enable=1, capture_background=1, soft_reset=1, interrupt_enable=1)
    # Bytes that are not strobed, and bits that are not there, do nothing.
    assert await write(master, AT["CONTROL"] + 1, 0xFF, 1) == OKAY
    await expect(master, CONTROL=bits("CONTROL", enable=1))
    assert await write(master, AT["CONTROL"], everything | 0xFFFFFF00) == OKAY
    wanted = int(IDENTITY.background_capture)
    await expect(master, CONTROL=bits("CONTROL", enable=1, capture_background=wanted, interrupt_enable=1))
    assert resets == 1
    if wanted:
        assert await level(dut, "capture_background")
        assert await write(master, AT["CONTROL"], bits("CONTROL", enable=1, interrupt_enable=1)) == OKAY
        assert await level(dut, "capture_background"), "a request can be taken back"
        await pulse(dut, background_taken=1)
        assert not await level(dut, "capture_background")
    await expect(master, CONTROL=bits("CONTROL", enable=1, interrupt_enable=1))
    assert await write(master, AT["CONTROL"], 0, 1) == OKAY
    await expect(master, CONTROL=0)
    assert not await level(dut, "enable")
    assert resets == 1
    counting.cancel()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def errors_stick_until_cleared(dut):
    master = await start(dut)
    for k, name in enumerate(ERRORS):
        if name == "frame_suspect" or not hasattr(dut, name):  # found by the registers themselves
            continue
        await pulse(dut, **{name: 1})
        await expect(master, ERRORS=1 << k)
        assert await write(master, AT["ERRORS"], ~(1 << k) & 0xFFFFFFFF) == OKAY
        assert await write(master, AT["ERRORS"] + 1, 0xFF, 1) == OKAY
        await expect(master, ERRORS=1 << k)
        assert await write(master, AT["ERRORS"], 1 << k, 1) == OKAY
        await expect(master, ERRORS=0)
    # One that happens while it is cleared stays.
    dut.no_start.value = 1
    assert await write(master, AT["ERRORS"], 0xFF) == OKAY
    dut.no_start.value = 0
    await expect(master, ERRORS=bits("ERRORS", no_start=1))


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def a_result_in_the_clock_of_a_soft_reset_is_forgotten(dut):
    master = await start(dut)
    reset = bits("CONTROL", enable=1, soft_reset=1)
    done, clocks = cocotb.start_soon(write(master, AT["CONTROL"], reset)), 0
    while not await level(dut, "soft_reset"):
        clocks += 1
    assert await done == OKAY
    # And again, now that it is known when it comes.
    await pulse(dut, frame_started=1)
    await RisingEdge(dut.clk)
    done = cocotb.start_soon(write(master, AT["CONTROL"], reset))
    await ClockCycles(dut.clk, clocks)
    names = {RESULT, "frame_done", "frame_bad"}
    for name in names:
        getattr(dut, name).value = 1
    assert await level(dut, "soft_reset")
    for name in names:
        getattr(dut, name).value = 0
    assert await done == OKAY
    await expect(master, INTERRUPT_STATUS=0, STATUS=0, ERRORS=0, FRAME_COUNT=0, FRAME_ERRORS=0)


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
    # The times below: the last beat at 20, the force at 52, the end of depth at 93.
    for k, bad in enumerate((1, 0)):
        assert not await level(dut, "interrupt")
        await frame(dut, clocks=20, bad=bad)
        await ClockCycles(dut.clk, 30)
        result = {RESULT: 1, "validity": FLAGS[k]}
        if IDENTITY.axes:
            result["force"] = pack(forces[k][: len(IDENTITY.axes)])
        await pulse(dut, **result)
        if IDENTITY.axes and IDENTITY.depth:
            await ClockCycles(dut.clk, 40)
            await pulse(dut, depth_done=1)
        assert await level(dut, "interrupt")
        suspect = int(FLAGS[k] > 0)
        status = bits("STATUS", result_valid=1, last_frame_bad=bad, last_frame_suspect=suspect)
        await expect(master, STATUS=status, FRAME_COUNT=2 + k, FRAME_ERRORS=1, INTERRUPT_STATUS=1)
        # What comes without a result is not of the last one.
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
    # How long an acknowledgement takes, then a result in the clock in which the next one takes effect.
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
async def force_of_64_bits_is_of_one_result(dut, stall):
    """Results arrive all the time while the host reads both halves and writes elsewhere."""
    master = await start(dut, stall=stall)

    async def results():
        k = 0
        while True:
            # Both halves say which result they belong to; the sign changes.
            k = (k + 1) % 127
            force = ~(k << 32 | k) if k % 2 else k << 32 | k
            await pulse(dut, **{RESULT: 1}, force=pack([force] * len(IDENTITY.axes)))

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


@cocotb.test(timeout_time=1, timeout_unit="ms", skip=not IDENTITY.calibration)
@cocotb.parametrize(stall=[0, 0.6])
async def calibration(dut, stall):
    """Words go to the loader, whole ones only; its answer, its state and its hash are the host's."""
    master = await start(dut, stall=stall)
    seen = []

    async def watch():
        while True:
            await ReadOnly()
            for what in ("write", "restart"):
                if int(getattr(dut, f"calibration__{what}").value):
                    seen.append((what, int(dut.calibration__word.value) if what == "write" else None))
            await RisingEdge(dut.clk)

    cocotb.start_soon(watch())
    dut.calibration__taken.value = 1
    for word in (0, 0xFFFFFFFF, 0x12345678):
        assert await write(master, AT["CALIBRATION"], word) == OKAY
    assert seen == [("write", 0), ("write", 0xFFFFFFFF), ("write", 0x12345678)]
    await expect(master, ERRORS=0, CALIBRATION=0)
    seen.clear()
    dut.calibration__taken.value = 0
    refused = bits("ERRORS", calibration_refused=1)
    for word, size, offered in ((7, 4, True), (7, 3, False), (7, 1, False)):
        assert await write(master, AT["CALIBRATION"], word, size) == SLVERR
        assert seen == [("write", word)] * offered
        seen.clear()
        await expect(master, ERRORS=refused)
        assert await write(master, AT["ERRORS"], ~refused & 0xFFFFFFFF) == OKAY
        await expect(master, ERRORS=refused)
        assert await write(master, AT["ERRORS"], refused) == OKAY
        await expect(master, ERRORS=0)
    assert not seen

    assert await write(master, AT["CONTROL"], bits("CONTROL", enable=1, restart_calibration=1)) == OKAY
    await expect(master, CONTROL=bits("CONTROL", enable=1))
    assert await write(master, AT["CONTROL"], bits("CONTROL", enable=1)) == OKAY
    assert seen == [("restart", None)]

    dut.calibration__loading.value, dut.calibration__received.value = 1, 0x10203
    await expect(master, STATUS=bits("STATUS", loading=1), CALIBRATION_RECEIVED=0x10203)
    dut.calibration__loading.value, dut.calibration__bundle_hash.value = 0, 0x0123456789ABCDEF
    await expect(master, STATUS=0, BUNDLE_HASH_LOW=0x89ABCDEF, BUNDLE_HASH_HIGH=0x01234567)


@cocotb.test(timeout_time=1, timeout_unit="ms", skip=not IDENTITY.calibration)
async def calibration_waits_for_frames(dut):
    """Idle in no clock from the one after a frame starts to the one in which its last result goes."""
    await start(dut)

    async def idle(*names):
        for name in names:
            getattr(dut, name).value = 1
        found = await level(dut, "calibration__idle")
        for name in names:
            getattr(dut, name).value = 0
        return found

    last = [f"{name}_done" for name in ("depth", "normals") if getattr(IDENTITY, name)]
    for _ in range(3):
        assert await idle()
        assert await idle("frame_started", "accepted")
        assert not await idle()
        assert not await idle("frame_done")
        for name in (["result_valid"] if IDENTITY.axes else []) + last:
            assert not await idle()
            assert not await idle(name)
    assert await idle()
