"""Proof of the register block with packets: the time, and each result's record on its way to the FIFO."""

from functools import partial

from amaranth import Const, Signal, Value

from fastac.gateware.bus.identity import Identity
from fastac.gateware.bus.record import (
    FIFO_RECORDS,
    FORMAT_LOW,
    RECORD_BYTES,
    RECORD_FORMAT,
    RECORD_WORDS,
    RecordFlag,
)
from fastac.gateware.bus.registers import RegisterBlock
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.registers import FORCE_WIDTH, Rules

PACKETS = Identity(
    *(0xFEDCBA9876543210, 7, 120, 300, 4, 2, "xz"),
    force_width=FORCE_WIDTH,
    slip=True,
    slip_limit=369,
    packets=True,
)
FIFO_PORTS = {
    "record": 8 * RECORD_BYTES,
    "word": 32,
    "waiting": range(FIFO_RECORDS + 1),
    "lost_count": 32,
    **dict.fromkeys(("record_valid", "read", "clear"), 1),
}
"""Ports of the result FIFO, with their shapes."""


def records(rules: Rules, known: dict[str, Value]) -> dict[str, Value]:
    """Time, and the record of a result, from the registers `known`; the FIFO has its own proof."""
    m, bench, dut = rules.m, rules.bench, rules.dut
    time, high = Signal(64), Signal(32)
    m.d.sync += time.eq(time + 1)
    with m.If(rules.reads("TIME_LOW")):  # latches the other half
        m.d.sync += high.eq(time[32:])
    bench.always("the time counts clocks", dut.time == time)
    bench.always("the register time_high", bench.probe("results.time_high", 32) == high)
    bench.always("a record for each result", dut.record_valid == bench.past(rules.result, "had_result"))

    number, bad, first, last = (
        bench.probe(f"timer.{name}", bits)
        for name, bits in (
            *(("force_number", 32), ("force_bad", 1)),
            *(("first_to_force", 32), ("last_to_force", 32)),
        )
    )
    began = bench.probe("timer.result_time", 64)
    suspect, slips = (
        known["FRAME_VALIDITY"].any(),
        known["SLIP_SPREAD"] > known["SLIP_LIMIT"],
    )
    named = {flag.name: flag.bit_length() - 1 for flag in RecordFlag}
    values = {"BAD": bad, "SUSPECT": suspect, "SLIP": slips, "COMPLETE": Const(1), "ABORTED": Const(0)}
    flags = sum(values[name].as_unsigned() << place for name, place in named.items())
    words = known | {
        "FRAME": number,
        "FLAGS": flags + (RECORD_FORMAT << FORMAT_LOW),
        "VALIDITY": known["FRAME_VALIDITY"],
        "TIME_LOW": began[:32],
        "TIME_HIGH": began[32:],
        "FIRST_TO_RESULT": first,
        "LAST_TO_RESULT": last,
    }
    for axis in rules.identity.axes:  # the register has what was latched, the record what it latches
        words[f"FORCE_{axis.upper()}_HIGH"] = rules.high_halves[axis]
    for k, name in enumerate(RECORD_WORDS):
        right = dut.record.word_select(k, 32) == words.get(name, 0)
        bench.always(f"word {name} of the record", ~dut.record_valid | right)

    fifo = {name: bench.probe(f"results.fifo.{name}", bits) for name, bits in FIFO_PORTS.items()}
    bench.always("the FIFO gets each record", fifo["record_valid"] == dut.record_valid)
    bench.always("the FIFO gets the record", fifo["record"] == dut.record)
    bench.always("a read of RESULTS_WORD takes a word", fifo["read"] == rules.reads("RESULTS_WORD"))
    bench.always("CONTROL.clear_results", fifo["clear"] == (rules.control & rules.ones[5]))
    return {
        "TIME_LOW": time[:32],
        "TIME_HIGH": high,
        "RESULTS_WAITING": fifo["waiting"],
        "RESULTS_WORD": fifo["word"],
        "RESULTS_LOST": fifo["lost_count"],
    }


def registers(component: type, identity: Identity) -> FormalBench:
    """Every register reads, is written and answers as the register map says; each result gives a record."""
    rules = Rules(component, identity)
    expected = rules.expected()
    rules.read_as(expected | records(rules, expected))
    return rules.bench


PROOFS = (
    Proof(
        "registers_packets",
        RegisterBlock,
        "force x and z, depth, slip; each result is a record too",
        partial(registers, identity=PACKETS),
        depth=2,
        breaks=(
            ('results.clear.eq(written("CONTROL") & ones[5])', "results.clear.eq(ones[5])"),
            ('results.read.eq(read("RESULTS_WORD"))', 'results.read.eq(read("RESULTS_WAITING"))'),
            ("results.time.eq(self.time)", "results.time.eq(timer.result_time)"),
            ("results.errors.eq(errors)", "results.errors.eq(errors & ~clear_errors)"),
            ('getattr(timer, f"last_to_{kind}")', 'getattr(timer, f"first_to_{kind}")'),
            ("results.slipping.eq(slipping)", "results.slipping.eq(0)"),
        ),
    ),
)
