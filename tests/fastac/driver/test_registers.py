"""Registers by name and field, with one-line errors for what cannot be accessed."""

import pytest

from fastac.driver.registers import Registers


@pytest.fixture
def memory() -> dict[int, int]:
    return {}


@pytest.fixture
def registers(description, memory) -> Registers:
    return Registers(description, lambda offset: memory.get(offset, 0), memory.__setitem__)


@pytest.fixture
def offsets(description) -> dict[str, int]:
    return {register.name: register.offset for register in description.registers}


def test_names_and_fields(registers, memory, offsets):
    registers.write("CONTROL", enable=1, interrupt_enable=1)
    assert memory == {offsets["CONTROL"]: 0b1001}
    registers.write("FRAME_TIMEOUT", 1 << 31)
    assert registers.read("FRAME_TIMEOUT") == 1 << 31
    memory[offsets["GEOMETRY"]] = 480 | 640 << 16
    assert registers.read("GEOMETRY", "width") == 640
    assert registers.fields("GEOMETRY") == {"height": 480, "width": 640}
    assert "CONTROL" in registers
    assert "NONSENSE" not in registers


def test_64_bits(registers, memory, offsets):
    memory[offsets["FORCE_X_LOW"]], memory[offsets["FORCE_X_HIGH"]] = 0xFFFFFFFE, 0xFFFFFFFF
    assert registers.read_long("FORCE_X", signed=True) == -2
    memory[offsets["TIME_HIGH"]] = 0xFFFFFFFF
    assert registers.read_long("TIME") == 0xFFFFFFFF << 32


def test_errors_are_taken_by_name(registers, memory, offsets):
    memory[offsets["ERRORS"]] = 1 << 31 | 0b100001
    assert registers.take_errors() == ("line_short", "gradient_saturated")
    assert memory[offsets["ERRORS"]] == 0b100001  # written to clear these, and no other bit


@pytest.mark.parametrize(
    ("access", "message"),
    [
        (lambda r: r.read("NONE"), "NONE: this hardware has no such register"),
        (lambda r: r.read("STATUS", "none"), "STATUS.none: no such field; there are busy, "),
        (lambda r: r.write("ID", 1), "ID: is read-only"),
        (lambda r: r.write("CONTROL", enable=2), "CONTROL.enable = 2: expected 1 bits"),
        (lambda r: r.write("FRAME_TIMEOUT", 1 << 32), "FRAME_TIMEOUT = 4294967296: expected 32 bits"),
    ],
)
def test_refusals(registers, memory, access, message):
    with pytest.raises(ValueError, match=message):
        access(registers)
    assert not memory
