"""FIFO of results for a host that reads them late: whole records in, 32-bit words out."""

from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib import memory, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.record import FIFO_RECORDS, RECORD_WORDS, WORD_BITS


class ResultFifo(wiring.Component):
    """Keep up to `records` records of `words` words of `width` bits until they are read word by word.

    Members
    -------
    record, record_valid : a record, word 0 in the least significant bits; high for one clock each. Records
        may come in adjacent clocks, for each is written whole in one clock.
    read : takes `word`, in the same clock; without a record it changes nothing
    word : the next word of the oldest record; 0 if there is none
    waiting : number of records whose last word has not been read
    clear : discard the records that wait; a record that comes in this clock is kept. Word 0 is the next one.
    lost : pulse: a record came while all places were taken, and is dropped. The last word of a record that is
        read in that clock does not make room for it any more.
    lost_count : unsigned(32), records dropped since reset, modulo 2**32

    A record is seen in `waiting` and `word` one clock after it came.
    """

    def __init__(self, records: int = FIFO_RECORDS, words: int = len(RECORD_WORDS), width: int = WORD_BITS):
        for name, value in (("records", records), ("words", words)):
            if value < 2 or value & (value - 1):
                raise ValueError(f"{name} {value}: expected a power of two, 2 or more")
        self.records, self.words, self.width = records, words, width
        super().__init__(
            {
                "record": In(unsigned(words * width)),
                "record_valid": In(1),
                "read": In(1),
                "word": Out(unsigned(width)),
                "waiting": Out(range(records + 1)),
                "clear": In(1),
                "lost": Out(1),
                "lost_count": Out(unsigned(32)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.storage = storage = memory.Memory(
            shape=unsigned(self.words * self.width), depth=self.records, init=[]
        )
        write, oldest = storage.write_port(), storage.read_port(domain="comb")
        newest = Signal(range(self.records))  # place of the next record
        first = Signal(range(self.records))  # place of the oldest record
        index = Signal(range(self.words))  # of the next word
        occupied, taken, finished = Signal(), Signal(), Signal()
        m.d.comb += [
            occupied.eq(self.waiting != 0),
            self.lost.eq(self.record_valid & (self.waiting == self.records) & ~self.clear),
            taken.eq(self.record_valid & ~self.lost),
            finished.eq(self.read & occupied & index.all()),
            write.addr.eq(newest),
            write.data.eq(self.record),
            write.en.eq(taken),
            oldest.addr.eq(first),
            self.word.eq(Mux(occupied, oldest.data.word_select(index, self.width), 0)),
        ]
        m.d.sync += [
            newest.eq(newest + taken),
            self.lost_count.eq(self.lost_count + self.lost),
        ]
        with m.If(self.clear):
            m.d.sync += [first.eq(newest), index.eq(0), self.waiting.eq(taken)]
        with m.Else():
            m.d.sync += [
                first.eq(first + finished),
                index.eq(index + (self.read & occupied)),
                self.waiting.eq(self.waiting + taken - finished),
            ]
        return m
