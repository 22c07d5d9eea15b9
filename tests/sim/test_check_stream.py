# amaranth: UnusedElaboratable=no
"""sim.check_stream accepts correct components and detects each kind of error."""

from itertools import pairwise

import pytest
from amaranth import Cat, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.sim.check_stream import check, pack, unpack

STUCK = 0xFF
"""After this word the component accepts no more."""


class Delay(wiring.Component):
    """Words delayed by `latency` clocks; `odd` is high with the odd ones."""

    def __init__(self, latency: int):
        self.latency = latency
        super().__init__(
            {"i": In(stream.Signature(8)), "o": Out(stream.Signature(8)), "odd": Out(1), "stuck": Out(1)}
        )

    def elaborate(self, platform):
        m = Module()
        valid = Signal(self.latency)
        words = [self.i.payload, *(Signal(8, name=f"word_{k}") for k in range(self.latency))]
        advance = self.o.ready | ~self.o.valid
        m.d.comb += [
            self.i.ready.eq(advance & ~self.stuck),
            self.o.valid.eq(valid[-1]),
            self.o.payload.eq(words[-1]),
            self.odd.eq(self.o.valid & self.o.payload[0]),
        ]
        with m.If(advance):
            m.d.sync += valid.eq(Cat(self.i.valid & self.i.ready, valid))
            m.d.sync += [after.eq(before) for before, after in pairwise(words)]
        with m.If(self.i.valid & self.i.ready & (self.i.payload == STUCK)):
            m.d.sync += self.stuck.eq(1)
        return m


class Fickle(wiring.Component):
    """Passes words on, rightly in the clocks in which they are taken, and breaks a rule while they wait."""

    def __init__(self, fault: str):
        self.fault = fault
        super().__init__({"i": In(stream.Signature(8)), "o": Out(stream.Signature(8))})

    def elaborate(self, platform):
        m = Module()
        phase = Signal()
        m.d.sync += phase.eq(~phase)
        offers = {"withdraws": phase, "waits": self.o.ready}.get(self.fault, 1)
        m.d.comb += [
            self.o.valid.eq(self.i.valid & offers),
            self.i.ready.eq(self.o.ready & offers),
            self.o.payload.eq(self.i.payload ^ ((self.fault == "changes") & ~self.o.ready)),
        ]
        return m


WORDS = [0x10, 0x21, 0x32, 0x43, 0x54, 0x65, 0x76]
LATENCY = 3
RIGHT = {
    "inputs": WORDS,
    "expected": WORDS,
    "latencies": [(k, k, LATENCY) for k in range(len(WORDS))],
    "flags": {"odd": 3},
    "timeout_cycles": 1000,
}
WRONG = {
    "a wrong value": ({"expected": [*WORDS[:-1], 0x77]}, "1 of 7 beats differ, the first is beat 6"),
    "a wrong bit among those compared": (
        {"expected": [word ^ 0x81 for word in WORDS], "mask": 0xF0},
        "7 of 7 beats differ",
    ),
    "a wrong order": ({"expected": [WORDS[1], WORDS[0], *WORDS[2:]]}, "2 of 7 beats differ"),
    "a missing beat": ({"expected": [*WORDS, 0x87]}, "hang: 7 of 8 after 1000 cycles"),
    "an extra beat": ({"expected": WORDS[:-1]}, "7 beats out, expected 6"),
    "a shorter latency": ({"latencies": [(6, 6, LATENCY + 1)]}, "[[6, 6, 3]], expected [[6, 6, 4]]"),
    "a longer latency": ({"latencies": [(6, 6, LATENCY - 1)]}, "[[6, 6, 3]], expected [[6, 6, 2]]"),
    "a missing flag": ({"flags": {"odd": 4}}, "flags {'odd': 3}, expected {'odd': 4}"),
    "an extra flag": ({"flags": {"odd": 2}}, "flags {'odd': 3}, expected {'odd': 2}"),
    "a hang": ({"inputs": [STUCK, *WORDS], "expected": [STUCK, *WORDS]}, "hang: 1 of 8"),
    "a pause of its own": (
        {"inputs": [STUCK, *WORDS], "expected": [STUCK, *WORDS], "elastic": True},
        "clock 1: `i` ready: 0, `o` waits: False",
    ),
    "a beat too few inside": ({"room": LATENCY}, "clock 3: `i` ready: 1, beats inside: 3"),
    "a place too few": (
        {"places": (1, 1), "stalls": (0.9,)},
        "1 beats taken before the first one left, expected 2",
    ),
    "an input that is not taken": (
        {"inputs": [*WORDS, STUCK, 0], "expected": [*WORDS, STUCK]},
        "hang: 8 of 8",
    ),
}


def test_a_correct_component_passes(tmp_path, capfd):
    """Latencies are checked on a component of known delay; bits that are not compared may differ."""
    check(Delay(LATENCY), "delay", tmp_path, elastic=True, places=(1, 0), **RIGHT)
    assert capfd.readouterr().out.count("PASS=3 FAIL=0") == 1
    changes = {"expected": [word ^ 1 for word in WORDS], "mask": 0xFE}
    check(Delay(LATENCY), "delay", tmp_path, stalls=(0,), **RIGHT | changes)


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.quick(
    "a wrong value",
    "an extra beat",
    "a longer latency",
    "a place too few",
    "an input that is not taken",
)
def test_each_error_is_detected(tmp_path, capfd, name):
    changes, message = WRONG[name]
    with pytest.raises((RuntimeError, SystemExit)):
        check(Delay(LATENCY), "delay", tmp_path, **{"stalls": (0,)} | RIGHT | changes)
    assert message in capfd.readouterr().out


@pytest.mark.parametrize("fault", ["withdraws", "changes"])
@pytest.mark.quick("changes")
def test_rules_of_streams_are_checked(tmp_path, capfd, fault):
    """`valid` holds and the payload is stable until a beat is taken."""
    with pytest.raises((RuntimeError, SystemExit)):
        check(Fickle(fault), "fickle", tmp_path, inputs=WORDS * 9, expected=WORDS * 9, stalls=(0.6,))
    assert "was withdrawn or changed at `o`" in capfd.readouterr().out


def test_valid_must_not_wait_for_ready(tmp_path, capfd):
    with pytest.raises((RuntimeError, SystemExit)):
        check(
            Fickle("waits"),
            "fickle",
            tmp_path,
            inputs=WORDS,
            expected=WORDS,
            stalls=(0.6,),
            timeout_cycles=1000,
        )
    assert "hang: 0 of 7" in capfd.readouterr().out


def test_pack_and_unpack():
    vectors = [[-1, 2, -128], [127, 0, 1]]
    packed = pack(vectors, 8)
    assert packed == [0x8002FF, 0x01007F]
    assert [unpack(payload, 8, 3) for payload in packed] == vectors
    assert unpack(0x8002FF, 8, 3, signed=False) == [255, 2, 128]
    # Nested layouts in C order, lane 0 lowest.
    assert pack([[[1, 2], [3, 4]]], 4) == [0x4321]
