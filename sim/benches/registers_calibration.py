"""cocotb testbench of RegisterBlock: loading a calibration."""

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from fastac.sim.benches.host import OKAY, start, write
from fastac.sim.benches.registers import AT, IDENTITY, REFUSED, bits, expect, level


@cocotb.test(timeout_time=1, timeout_unit="ms", skip=not IDENTITY.calibration)
@cocotb.parametrize(stall=[0, 0.6])
async def calibration(dut, stall):
    """Only whole words go to the loader; the host sees its response, its state and its hash."""
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
        assert await write(master, AT["CALIBRATION"], word, size) == REFUSED
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
    """`idle` is low from the clock after a frame's start to the clock of its last result."""
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
