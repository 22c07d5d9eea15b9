import numpy as np
import pytest
from amaranth import Const, Module, Signal
from amaranth.sim import Simulator

from fastac.gateware.bus.record import PLAIN, RECORD_BYTES, RECORD_WORDS, RecordFlag
from fastac.gateware.bus.result_registers import flags_word, record_value


def evaluated(value) -> int:
    """The integer that an Amaranth value without inputs is."""
    m, found = Module(), Signal(len(value))
    m.d.comb += found.eq(value)
    result = []

    async def bench(ctx):
        result.append(ctx.get(found))

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()
    return result[0]


def test_layout_is_that_of_the_words():
    """Written word by word, read by the NumPy type: names, places, signs and byte order."""
    assert (len(RECORD_WORDS), RECORD_BYTES, PLAIN.layout.itemsize) == (16, 64, 64)
    words = {name: 0xF0E0D0C0 + k for k, name in enumerate(RECORD_WORDS)}
    octets = b"".join(word.to_bytes(4, "little") for word in words.values())
    (record,) = np.frombuffer(octets, PLAIN.layout)
    for name in record.dtype.names:
        if name.upper() in words:
            assert record[name] == words[name.upper()]
        else:
            whole = words[f"{name.upper()}_HIGH"] << 32 | words[f"{name.upper()}_LOW"]
            assert record[name] == (whole if name == "time" else whole - (1 << 64))
    halves = [name for name in record.dtype.names if name.upper() not in words]
    assert halves == ["time", "force_x", "force_y", "force_z"]


def test_hardware_packs_what_the_layout_reads():
    words = {name: Const(k + 1, 5) for k, name in enumerate(RECORD_WORDS) if name != "SLIP_DOTS"}
    octets = evaluated(record_value(**words)).to_bytes(RECORD_BYTES, "little")
    assert [int(word) for word in np.frombuffer(octets, "<u4")] == [*range(1, 16), 0]
    assert len(record_value()) == PLAIN.bits == 8 * RECORD_BYTES


@pytest.mark.parametrize("flag", RecordFlag)
def test_each_flag_has_its_bit(flag):
    assert evaluated(flags_word(**{flag.name.lower(): Const(1, 1)})) == int(flag) | 1 << 8


def test_invalid_words():
    with pytest.raises(ValueError, match=r"^SPEED: expected one of"):
        record_value(SPEED=Const(0, 1))
    with pytest.raises(ValueError, match=r"^FRAME of 33 bits: expected at most 32$"):
        record_value(FRAME=Const(0, 33))
