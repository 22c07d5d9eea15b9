"""cocotb testbench of RegisterBlock: records of results, the FIFO they wait in, and the time.

No simulation lasts until 64 bits wrap: the time begins with the value in the variable TIME.
"""

import os
import random

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from fastac.gateware.bus.record import FIFO_RECORDS, PLAIN, RECORD_BYTES, RECORD_WORDS, RecordFlag
from fastac.models.integer.frame_validity import REASONS
from fastac.sim.benches.host import OKAY, read, start, write
from fastac.sim.benches.registers import (
    AT,
    IDENTITY,
    RESULT,
    bits,
    expect,
    frame,
    level,
    pack_forces,
    pulse,
)

WANTED = {"skip": not IDENTITY.packets, "timeout_time": 1, "timeout_unit": "ms"}
WRAP = 1 << 64
TIME = int(os.environ["TIME"])


def records_of(dut):
    """A list that grows by a record, as bytes, in each clock with a pulse of `record_valid`."""
    found = []

    async def watch():
        while True:
            await ReadOnly()
            if int(dut.record_valid.value):
                found.append(int(dut.record.value).to_bytes(RECORD_BYTES, "little"))
            await RisingEdge(dut.clk)

    cocotb.start_soon(watch())
    return found


async def next_record(master) -> bytes:
    """The oldest record, read word by word from RESULTS_WORD."""
    octets = b""
    for _ in RECORD_WORDS:
        word, response = await read(master, AT["RESULTS_WORD"])
        assert response == OKAY
        octets += word.to_bytes(4, "little")
    return octets


async def result(dut, rng, flag: int | None = None) -> dict:
    """A frame and its result, of random numbers and times; returns what its record has to say.

    flag : the only bit of FRAME_VALIDITY that is set, or none if there is no such bit; None: any bits
    """
    beats, delay, bad = rng.randint(3, 40), rng.randint(2, 60), rng.getrandbits(1)
    before = await level(dut, "time")
    await frame(dut, clocks=beats, bad=bad)
    await ClockCycles(dut.clk, delay)
    every = (1 << len(REASONS)) - 1
    validity = rng.randint(0, every) if flag is None else (1 << flag) & every
    values = {RESULT: 1, "validity": validity}
    forces = [rng.getrandbits(IDENTITY.force_width) for _ in IDENTITY.axes]
    flags = RecordFlag.COMPLETE | RecordFlag.BAD * bad | RecordFlag.SUSPECT * (validity > 0)
    expected = {"validity": validity, "time": (before + 1) % WRAP}
    # `frame` accepts the first beat now, and the last one a clock before `frame_done`.
    expected |= {"first_to_result": beats + delay + 2, "last_to_result": delay + 2}
    if IDENTITY.axes:
        values["force"] = pack_forces(forces)
        limit = 1 << IDENTITY.force_width
        signed = [force - limit * (force >= limit // 2) for force in forces]
        expected |= {f"force_{axis}": force for axis, force in zip(IDENTITY.axes, signed, strict=True)}
    if IDENTITY.slip:
        values |= {"spread": rng.getrandbits(32), "touching": rng.getrandbits(32)}
        expected |= {"slip_spread": values["spread"], "slip_dots": values["touching"]}
        flags |= RecordFlag.SLIP * (values["spread"] > IDENTITY.slip_limit)
    await pulse(dut, **values)
    await pulse(dut, **dict.fromkeys(values, 0))
    return expected | {"flags": int(flags) | 1 << 8}


def check(octets: bytes, expected: dict) -> None:
    """Compare a record with the fields that are expected; the others must be 0."""
    (record,) = np.frombuffer(octets, PLAIN.layout)
    found = {name: int(record[name]) for name in record.dtype.names}
    assert found == dict.fromkeys(found, 0) | expected


@cocotb.test(**WANTED)
async def a_record_of_each_result(dut):
    """In one clock for packets, word by word for the host."""
    master = await start(dut)
    given, rng = records_of(dut), random.Random(1)
    await expect(master, RESULTS_WAITING=0, RESULTS_WORD=0, RESULTS_LOST=0)
    for number in range(1, 60):
        faults = rng.choice(((), ("line_long",), ("frame_timeout", "no_start")))
        await pulse(dut, **dict.fromkeys(faults, 1))
        expected = await result(dut, rng, number // 2 % (len(REASONS) + 1) if number % 2 else None)
        errors = bits("ERRORS", **dict.fromkeys(faults, 1), frame_suspect=int(expected["validity"] > 0))
        expected |= {"frame": number, "errors": errors}
        await RisingEdge(dut.clk)
        assert len(given) == number
        check(given[-1], expected)
        await expect(master, RESULTS_WAITING=1, ERRORS=errors)
        assert await next_record(master) == given[-1]
        await expect(master, RESULTS_WAITING=0, RESULTS_WORD=0)
        await write(master, AT["ERRORS"], 0xFFFFFFFF)
        await write(master, AT["INTERRUPT_STATUS"], 1)


@cocotb.test(**WANTED)
async def results_wait_and_the_newest_are_lost(dut):
    """Older records stay whole; those that are lost are counted and flagged."""
    master = await start(dut)
    given, rng = records_of(dut), random.Random(2)
    lost = bits("ERRORS", results_lost=1)

    async def results(count):
        for _ in range(count):
            await result(dut, rng)
            await write(master, AT["ERRORS"], 0xFFFFFFFF & ~lost)

    await results(FIFO_RECORDS)
    await write(master, AT["INTERRUPT_STATUS"], 1)
    await expect(master, RESULTS_WAITING=FIFO_RECORDS, RESULTS_LOST=0, ERRORS=0)
    await results(3)
    await expect(master, RESULTS_WAITING=FIFO_RECORDS, RESULTS_LOST=3, ERRORS=lost)
    assert await write(master, AT["ERRORS"], lost) == OKAY
    await expect(master, RESULTS_LOST=3, ERRORS=0)
    kept, words = given[:FIFO_RECORDS], []
    for _ in RECORD_WORDS[:-1]:
        words.append((await read(master, AT["RESULTS_WORD"]))[0])
    await results(1)  # the oldest record still has a word
    await expect(master, RESULTS_WAITING=FIFO_RECORDS, RESULTS_LOST=4)
    words.append((await read(master, AT["RESULTS_WORD"]))[0])
    assert b"".join(word.to_bytes(4, "little") for word in words) == kept[0]
    await expect(master, RESULTS_WAITING=FIFO_RECORDS - 1)
    await results(1)
    kept.append(given[-1])
    for k, octets in enumerate(kept[1:]):
        assert await next_record(master) == octets, k
    await expect(master, RESULTS_WAITING=0, RESULTS_WORD=0, RESULTS_LOST=4)


@cocotb.test(**WANTED)
async def cleared_results(dut):
    """CONTROL.clear_results discards what waits, inside a record too; a soft reset does not."""
    master = await start(dut)
    given, rng = records_of(dut), random.Random(3)
    clear = bits("CONTROL", enable=1, clear_results=1)
    for partly_read in (0, 1, 5, 15):
        for _ in range(2):
            await result(dut, rng)
        for _ in range(partly_read):
            await read(master, AT["RESULTS_WORD"])
        await write(master, AT["CONTROL"], bits("CONTROL", enable=1, soft_reset=1))
        await expect(master, RESULTS_WAITING=2)
        assert await write(master, AT["CONTROL"] + 1, 0xFF, 1) == OKAY
        await expect(master, RESULTS_WAITING=2)
        assert await write(master, AT["CONTROL"], clear) == OKAY
        await expect(master, CONTROL=bits("CONTROL", enable=1), RESULTS_WAITING=0, RESULTS_WORD=0)
        await result(dut, rng)
        assert await next_record(master) == given[-1]
    await expect(master, RESULTS_LOST=0)


@cocotb.test(**WANTED)
async def results_in_adjacent_clocks(dut):
    """None is lost or mixed with another, though no datapath gives them so fast."""
    master = await start(dut)
    given = records_of(dut)
    for k in range(1, 9):
        values = {"force": pack_forces([k] * len(IDENTITY.axes))} if IDENTITY.axes else {}
        await pulse(dut, **{RESULT: 1}, validity=k, **values)
    await pulse(dut, validity=0)
    await RisingEdge(dut.clk)
    for k in range(8):
        octets = await next_record(master)
        assert octets == given[k]
        (record,) = np.frombuffer(octets, PLAIN.layout)
        assert record["validity"] == k + 1
        assert all(record[f"force_{axis}"] == k + 1 for axis in IDENTITY.axes)


@cocotb.test(**WANTED)
async def both_halves_of_the_time_are_of_one_clock(dut):
    master = await start(dut)
    assert 0 <= (await level(dut, "time") - TIME) % WRAP < 10
    rng, halves = random.Random(4), set()
    for _ in range(60):
        before = await level(dut, "time")
        low, _ = await read(master, AT["TIME_LOW"])
        await ClockCycles(dut.clk, rng.randint(0, 16))
        high, _ = await read(master, AT["TIME_HIGH"])
        assert 0 < ((high << 32 | low) - before) % WRAP < 8
        halves.add(high)
    assert len(halves) == 2, "no carry from one half to the other"
    await write(master, AT["CONTROL"], bits("CONTROL", enable=1, soft_reset=1))
    clock = await level(dut, "time")
    assert 0 < (clock - before) % WRAP < 100, "a soft reset leaves the time"
