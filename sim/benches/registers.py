"""cocotb testbench of RegisterBlock: every address, CONTROL, and the sticky error flags.

The identity of the hardware is in the variable IDENTITY. registers_results.py and registers_calibration.py
have the other tests.
"""

import json
import os
import random

import cocotb
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import FIFO_RECORDS
from fastac.gateware.bus.register_map import ERRORS, REGISTERS
from fastac.gateware.bus.registers import ERRORS_DETECTED_HERE
from fastac.sim.benches.host import DECERR, OKAY, SLVERR, read, start, write

IDENTITY = Identity(**json.loads(os.environ["IDENTITY"]))
AT = {register.name: register.offset for register in IDENTITY.registers}
FIELDS = {register.name: {field.name: field for field in register.fields} for register in REGISTERS}
FLAGS = (0x155, 0)
"""FRAME_VALIDITY of two frames, one with and one without flags."""
RESPONDS = IDENTITY.bus_errors == "respond"
NO_REGISTER, REFUSED = (DECERR, SLVERR) if RESPONDS else (OKAY, OKAY)
"""Responses to an access without a register, and to one that a register refuses."""
RESULT = "result_valid" if IDENTITY.axes else "depth_done"
"""Input that pulses with a frame's result."""


def bits(register, **values):
    """The value of a register with these fields."""
    return sum(value << FIELDS[register][name].low for name, value in values.items())


async def expect(master, **values):
    """Read the named registers and compare values and responses."""
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
    """Pulses of a frame whose first beat is accepted now and whose last beat `clocks` later."""
    await pulse(dut, accepted=1)
    await pulse(dut, frame_started=1)
    await ClockCycles(dut.clk, clocks - 2)
    await pulse(dut, accepted=1)
    await pulse(dut, frame_done=1, frame_bad=bad)


async def level(dut, name):
    """The value of an output in this clock; ends in the next clock."""
    await ReadOnly()
    value = int(getattr(dut, name).value)
    await RisingEdge(dut.clk)
    return value


def pulses_of(dut, name):
    """A list that grows by one entry in each clock in which an output is high, until the test ends."""
    found = []

    async def watch():
        while True:
            if await level(dut, name):
                found.append(name)

    cocotb.start_soon(watch())
    return found


def pack_forces(forces):
    """The accumulators of all axes as one payload, first axis lowest."""
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
        "FRAME_TIMEOUT": IDENTITY.frame_timeout,
    }
    counts = {name: getattr(IDENTITY, name) for name in ("channels", "lanes")}
    outputs = ("depth", "background_capture", "normals", "force_map", "rows_reversed", "slip", "packets")
    counts |= {name: int(getattr(IDENTITY, name)) for name in outputs}
    counts |= {f"force_{axis}": int(axis in IDENTITY.axes) for axis in "xyz"}
    values["CAPABILITIES"] = bits("CAPABILITIES", **counts)
    if IDENTITY.slip:
        values["SLIP_LIMIT"] = IDENTITY.slip_limit
    if IDENTITY.calibration:
        dut.calibration__bundle_hash.value = IDENTITY.bundle_hash
        values["CALIBRATION_WORDS"] = IDENTITY.calibration_words
        values["CALIBRATION_LAYOUT"] = IDENTITY.calibration_layout
        values["CAPABILITIES"] |= bits("CAPABILITIES", calibration=1)
    resets = IDENTITY.resets
    assert resets == {name: values[name] if resets[name] is not None else None for name in AT}
    if IDENTITY.packets:
        del values["TIME_LOW"]  # the time goes on
    await expect(master, **values)
    registers = {register.offset: register for register in IDENTITY.registers}
    soft_resets = pulses_of(dut, "soft_reset")
    refused = bits("ERRORS", access_refused=1)
    for address in range(0, 256, 4):
        if address not in registers:
            assert await read(master, address) == (0, NO_REGISTER), hex(address)
            await expect(master, ERRORS=refused)
            assert await write(master, AT["ERRORS"], refused) == OKAY
            assert await write(master, address, 0xFFFFFFFF) == NO_REGISTER, hex(address)
        elif registers[address].access == "ro":
            assert await write(master, address, 0xFFFFFFFF) == REFUSED, registers[address].name
        else:
            continue
        await expect(master, ERRORS=refused)
        assert await write(master, AT["ERRORS"], refused) == OKAY
    if IDENTITY.packets:
        del values["TIME_HIGH"]
    await expect(master, **values)
    assert not soft_resets


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def control(dut):
    master = await start(dut)
    assert await level(dut, "enable")
    resets = pulses_of(dut, "soft_reset")
    everything = bits("CONTROL", enable=1, capture_background=1, soft_reset=1, interrupt_enable=1)
    # Bytes without a strobe are not written, and bits that do not exist are ignored.
    assert await write(master, AT["CONTROL"] + 1, 0xFF, 1) == OKAY
    await expect(master, CONTROL=bits("CONTROL", enable=1))
    assert await write(master, AT["CONTROL"], everything | 0xFFFFFF00) == OKAY
    wanted = int(IDENTITY.background_capture)
    await expect(master, CONTROL=bits("CONTROL", enable=1, capture_background=wanted, interrupt_enable=1))
    assert len(resets) == 1
    if wanted:
        assert await level(dut, "capture_background")
        assert await write(master, AT["CONTROL"], bits("CONTROL", enable=1, interrupt_enable=1)) == OKAY
        assert await level(dut, "capture_background"), "writing 0 cancelled the request"
        await pulse(dut, background_taken=1)
        assert not await level(dut, "capture_background")
    await expect(master, CONTROL=bits("CONTROL", enable=1, interrupt_enable=1))
    assert await write(master, AT["CONTROL"], 0, 1) == OKAY
    await expect(master, CONTROL=0)
    assert not await level(dut, "enable")
    assert len(resets) == 1


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def errors_stick_until_cleared(dut):
    master = await start(dut)
    for k, name in enumerate(ERRORS):
        if name in ERRORS_DETECTED_HERE:
            continue
        await pulse(dut, **{name: 1})
        await expect(master, ERRORS=1 << k)
        assert await write(master, AT["ERRORS"], ~(1 << k) & 0xFFFFFFFF) == OKAY
        octet, bit = divmod(k, 8)
        assert await write(master, AT["ERRORS"] + 1 - octet, 0xFF, 1) == OKAY
        await expect(master, ERRORS=1 << k)
        assert await write(master, AT["ERRORS"] + octet, 1 << bit, 1) == OKAY
        await expect(master, ERRORS=0)
    # An error in the clock in which it is cleared stays set.
    dut.no_start.value = 1
    assert await write(master, AT["ERRORS"], 0xFF) == OKAY
    dut.no_start.value = 0
    await expect(master, ERRORS=bits("ERRORS", no_start=1))


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def any_errors_are_cleared_and_others_kept(dut):
    master = await start(dut)
    rng, value = random.Random(1), 0
    masks = {name: 1 << k for k, name in enumerate(ERRORS)}
    inputs = [name for name in ERRORS if name not in ERRORS_DETECTED_HERE]
    nowhere = next(address for address in range(0, 256, 4) if address not in AT.values())
    if IDENTITY.calibration:
        dut.calibration__taken.value = 0
    await pulse(dut, **{RESULT: 1})  # nobody acknowledges it: every later one is an overrun
    waiting = 1
    for _ in range(40):
        seen = rng.sample(inputs, rng.randint(0, len(inputs)))
        await pulse(dut, **dict.fromkeys(seen, 1))
        result, suspect, unmapped, refused = (rng.getrandbits(1) for _ in range(4))
        if result:
            await pulse(dut, **{RESULT: 1}, validity=suspect)
            seen += ["result_overrun", *["frame_suspect"] * suspect]
            seen += ["results_lost"] * (IDENTITY.packets and waiting == FIFO_RECORDS)
            waiting = min(waiting + 1, FIFO_RECORDS)
        if unmapped:
            await read(master, nowhere)
            seen.append("access_refused")
        if refused and IDENTITY.calibration:
            await write(master, AT["CALIBRATION"], 0)
            seen.append("calibration_refused")
        cleared = rng.getrandbits(32)
        assert await write(master, AT["ERRORS"], cleared) == OKAY
        value = (value | sum(masks[name] for name in seen)) & ~cleared
        await expect(master, ERRORS=value)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frame_timeout(dut):
    """The register's initial value is the identity's."""
    master = await start(dut)
    assert await level(dut, "timeout_clocks") == IDENTITY.frame_timeout
    async for value in any_bytes(master, "FRAME_TIMEOUT"):
        assert await level(dut, "timeout_clocks") == value


async def any_bytes(master, register):
    """Write bytes of a register by their strobes, and read it; yields each value."""
    assert await write(master, AT[register], 0x12345678) == OKAY
    assert await write(master, AT[register] + 1, 0xFF, 1) == OKAY
    await expect(master, **{register: 0x1234FF78}, ERRORS=0)
    rng, value = random.Random(1), 0x1234FF78
    for _ in range(20):
        first = rng.randrange(4)
        size, data = rng.randint(1, 4 - first), rng.getrandbits(32)
        data &= (1 << 8 * size) - 1
        assert await write(master, AT[register] + first, data, size) == OKAY
        value = value & ~(((1 << 8 * size) - 1) << 8 * first) | data << 8 * first
        await expect(master, **{register: value})
        yield value
