"""Constants in block RAM beside a stream, read a beat ahead, so that a word has a clock more to travel in."""

import numpy as np
from amaranth import Array, Module, Mux, Signal, unsigned
from amaranth.lib.memory import Memory

from fastac.gateware.stream.tables import RasterRom

BANK_WORDS = 2048
"""Words of a bank: a block RAM of 18 Kbit has so many of 9 bits, on AMD parts and on the ECP5."""


class ReadAheadRom(RasterRom):
    """Table in block RAM that holds the next beat's word ready, read word by word, and again after the last.

    For wide and deep tables, whose block RAMs lie far from each other: after the memory's own register a
    word passes two more on its way to the multipliers, at the latency of `RasterRom`, which has one. Between
    these two it is chosen from banks of BANK_WORDS words. It cannot be written, as the first word of a frame
    is read before the frame comes.

    Parameters, `word` and `latency` are those of `RasterRom`; no register has a clock enable.

    Members
    -------
    take : a beat enters the pipeline and uses the next word; low in the first clock after a reset, in which
        the memory is read for the first time
    """

    def __init__(self, table: np.ndarray, bits: int):
        super().__init__(table, bits, stalls=False)

    def elaborate(self, platform):
        m = Module()
        depth = len(self.table)
        holds_word, address, reads = Signal(), Signal(range(depth)), Signal()
        m.d.comb += reads.eq(self.take | ~holds_word)
        m.d.sync += holds_word.eq(1)
        with m.If(reads):
            m.d.sync += address.eq(Mux(address == depth - 1, 0, address + 1))

        # The bank of the word that the memory holds ready, and of the word in the banks' second registers.
        place = BANK_WORDS.bit_length() - 1
        bank = address[place:]
        ready, passed = Signal.like(bank, name="ready"), Signal.like(bank, name="passed")
        m.d.sync += passed.eq(ready)
        with m.If(reads):
            m.d.sync += ready.eq(bank)
        width, words = self.word.as_value().shape().width, self.words
        banks = []
        for number, first in enumerate(range(0, depth, BANK_WORDS)):
            own = words[first : first + BANK_WORDS]
            m.submodules[f"bank_{number}"] = memory = Memory(
                shape=unsigned(width), depth=len(own), init=own, attrs={"rom_style": "block"}
            )
            read = memory.read_port()
            word = Signal(width, reset_less=True, name=f"word_{number}")
            m.d.comb += [read.addr.eq(address[:place]), read.en.eq(reads & (bank == number))]
            m.d.sync += word.eq(read.data)
            banks.append(word)
        output = Signal(width, reset_less=True)
        m.d.sync += output.eq(Array(banks)[passed])
        m.d.comb += self.word.as_value().eq(output)
        return m
