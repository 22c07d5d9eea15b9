"""Proof of the result FIFO: records leave whole, in order, each once, and those that are lost are counted."""

from functools import partial

from amaranth import Array, Mux, Signal

from fastac.gateware.bus.result_fifo import ResultFifo
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.in_order import InOrder
from fastac.sim.formal.proof import Proof

WIDTH = 2


def result_fifo(component: type, records: int, words: int) -> FormalBench:
    """A record is what has been read from one word 0 to its last word; all inputs are free in any clock."""
    bench = FormalBench(component(records=records, words=words, width=WIDTH))
    dut, m = bench.dut, bench.m
    record, comes, read, clear = (
        bench.free("record", words * WIDTH),
        *(bench.free(name) for name in ("comes", "read", "clear")),
    )
    for port, value in (
        (dut.record, record),
        (dut.record_valid, comes),
        (dut.read, read),
        (dut.clear, clear),
    ):
        bench.drive(port, value)

    # The words of the oldest record that the host has read, and its next one.
    index = Signal(range(words))
    had = Signal(words * WIDTH)
    takes = bench.wire("takes", read & (dut.waiting != 0))
    whole = Signal.like(had)
    m.d.comb += whole.eq(had)
    with m.If(takes):
        m.d.comb += whole.word_select(index, WIDTH).eq(dut.word)
        m.d.sync += [had.eq(whole), index.eq(index + 1)]
    with m.If(clear):
        m.d.sync += [index.eq(0), had.eq(0)]

    enters = bench.wire("enters", comes & ~dut.lost)
    leaves = bench.wire("leaves", takes & (index == words - 1))
    track = InOrder(bench, enters, record, leaves, whole, capacity=records, clear=clear)
    newest, first = (bench.probe(name, range(records)) for name in ("newest", "first"))
    memory = Array(bench.probe(f"storage[{k}]", words * WIDTH) for k in range(records))
    track.stored(bench, [memory[(first + k) % records] for k in range(records)])
    bench.always("inside are the records that wait", track.inside == dut.waiting)
    bench.always("`waiting` lies between the two places", (newest - first)[: len(first)] == dut.waiting[:-1])
    bench.always("the next word is the one after those read", bench.probe("index", range(words)) == index)
    oldest = memory[first]
    for k in range(words):
        read_before = (dut.waiting != 0) & (k < index)
        right = had.word_select(k, WIDTH) == oldest.word_select(k, WIDTH)
        bench.always(f"word {k} was the oldest record's", ~read_before | right)
    bench.always("no word is left without a record", (dut.waiting != 0) | (index == 0))
    bench.always("reads 0 while none waits", (dut.waiting != 0) | (dut.word == 0))

    lost = Signal(32)
    m.d.sync += lost.eq(lost + dut.lost)
    full = dut.waiting == records
    bench.always("a record is lost only if all places are taken", dut.lost == (comes & full & ~clear))
    bench.always("every lost record is counted", dut.lost_count == lost)
    kept = Mux(clear, comes, dut.waiting + (comes & ~full) - leaves)
    bench.always("`waiting` counts", bench.past(kept, "counted") == dut.waiting)
    return bench


BREAKS = (
    ("newest.eq(newest + taken)", "newest.eq(newest + self.record_valid)"),
    ("write.en.eq(taken)", "write.en.eq(self.record_valid)"),
    ("& index.all()", ""),
    ("index.eq(index + (self.read & occupied))", "index.eq(index + self.read)"),
    ("(self.waiting == self.records) & ~self.clear", "(self.waiting == self.records)"),
    ("index.eq(0), self.waiting.eq(taken)", "self.waiting.eq(taken)"),
    ("self.lost_count + self.lost", "self.lost_count + (self.lost & ~self.read)"),
    ("Mux(occupied, oldest.data", "Mux(1, oldest.data"),
)

PROOFS = tuple(
    Proof(
        f"result_fifo_{records}_{words}",
        ResultFifo,
        f"{records} records of {words} words of {WIDTH} bits; records are stored, and words chosen by number",
        partial(result_fifo, records=records, words=words),
        depth=2,
        breaks=BREAKS,
        quick=records == 2,
    )
    for records, words in ((2, 2), (4, 4))
)
