# amaranth: UnusedElaboratable=no
import json
from dataclasses import asdict

import pytest
from amaranth import Signal

from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.register_map import ADDRESS_WIDTH, ERRORS, REGISTERS
from fastac.gateware.bus.registers import RegisterBlock
from fastac.gateware.stream import frame_guard
from fastac.sim.runner import simulate

BENCHES = (
    "fastac.sim.benches.registers",
    "fastac.sim.benches.registers_results",
    "fastac.sim.benches.registers_calibration",
    "fastac.sim.benches.registers_records",
)
TIME = 0xA5C3_96FF_FFFF_FE00
"""The time at the beginning: 512 clocks before a carry into its upper half."""
SHAPE = {
    "bundle_hash": 0xFEDCBA9876543210,
    "version": 3,
    "height": 120,
    "width": 300,
    "channels": 4,
    "lanes": 2,
}


@pytest.mark.parametrize(
    "outputs",
    [
        {
            "axes": "xyz",
            "depth": True,
            "background_capture": True,
            "force_width": 40,
            "frame_timeout": 15_000_000,
            "slip": True,
            "slip_limit": 0x9ABCDEF0,
            "packets": True,
        },
        {"axes": "z", "depth": False, "background_capture": False, "force_width": 64},
        {"axes": "", "depth": True, "background_capture": False, "packets": True},
        {
            "axes": "yz",
            "calibration_words": 70_000,
            "calibration_layout": 0xFEDCBA98,
            "bus_errors": "respond",
        },
    ],
    ids=["all but calibration, packets", "force z", "depth, packets", "force yz, depth, calibration"],
)
@pytest.mark.quick("all but calibration, packets", "force yz, depth, calibration")
def test_registers(tmp_path, outputs):
    identity = Identity(**SHAPE, **outputs)
    block = RegisterBlock(identity)
    if identity.packets:
        block.time = Signal(64, init=TIME)
    simulate(
        block,
        "registers",
        ",".join(BENCHES),
        tmp_path,
        IDENTITY=json.dumps(asdict(identity)),
        TIME=str(TIME),
    )


def test_register_map_is_consistent():
    offsets = [register.offset for register in REGISTERS]
    assert len({register.name for register in REGISTERS}) == len(set(offsets)) == len(REGISTERS)
    assert all(offset % 4 == 0 and offset < 1 << ADDRESS_WIDTH for offset in offsets)
    assert all(register.access in ("ro", "rw", "w1c", "wo") and register.meaning for register in REGISTERS)
    for register in REGISTERS:
        mask = 0
        for field in register.fields:
            bits = ((1 << field.width) - 1) << field.low
            assert not mask & bits, f"{register.name}.{field.name}"
            mask |= bits
        assert mask < 1 << 32, register.name
    assert set(frame_guard.FRAME_FAULTS) < set(ERRORS)


def test_absent_outputs_have_no_registers_or_ports():
    names = {register.name for register in Identity(**SHAPE, axes="").registers}
    assert not [name for name in names if "FORCE" in name]
    names = {register.name for register in Identity(**SHAPE, axes="z", depth=False).registers}
    assert not [name for name in names if name.endswith("DEPTH") or name.startswith("FORCE_X")]
    assert "FORCE_Z_HIGH" in names
    block = RegisterBlock(Identity(**SHAPE, axes="z", depth=False)).signature.members
    assert "depth_done" not in block
    assert "capture_background" not in block
    assert "calibration" not in block
    assert not [name for name in names if "CALIBRATION" in name]
    assert not [name for name in names if "SLIP" in name]
    assert not {"spread", "touching"} & block.keys()
    slipping = Identity(**SHAPE, axes="z", slip=True)
    found = [register.name for register in slipping.registers if "SLIP" in register.name]
    assert found == ["SLIP_SPREAD", "SLIP_DOTS", "SLIP_LIMIT"]
    assert {"spread", "touching"} < RegisterBlock(slipping).signature.members.keys()
    loadable = Identity(**SHAPE, axes="z", calibration_words=9)
    assert len([register for register in loadable.registers if "CALIBRATION" in register.name]) == 4
    assert "calibration" in RegisterBlock(loadable).signature.members


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"axes": "zx"}, r"axes 'zx': expected some of 'xyz', in this order"),
        ({"axes": "", "depth": False}, "axes '', depth False, normals False: expected at least one output"),
        ({"bundle_hash": 1 << 64}, "bundle_hash 18446744073709551616: expected 0 to"),
        ({"height": 1 << 16}, "height 65536: expected 1 to 65535"),
        ({"frame_timeout": 1 << 32}, "frame_timeout 4294967296: expected 0 to 4294967295"),
        ({"slip_limit": 1 << 32}, "slip_limit 4294967296: expected 0 to 4294967295"),
        ({"axes": "", "slip": True}, "slip True: expected axes of force, with which it is sampled"),
        ({"bus_errors": "ignore"}, r"bus_errors 'ignore': expected one of \('flag', 'respond'\)"),
        ({"force_width": 65}, "force_width 65: expected 1 to 64"),
        ({"calibration_layout": -1}, "calibration_layout -1: expected 0 to 4294967295"),
    ],
)
def test_invalid_arguments(changed, message):
    with pytest.raises(ValueError, match=message):
        Identity(**{**SHAPE, "axes": "xyz", **changed})
