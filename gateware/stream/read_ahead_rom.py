"""Constants in block RAM beside a stream, read ahead into a short queue: words have time to travel."""

import numpy as np
from amaranth import Array, Cat, Module, Mux, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.fifo import SyncFIFO
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.tables import packed_words, word_layout

BANK_WORDS = 2048
"""Words of a bank: a block RAM of 18 Kbit has so many of 9 bits, on AMD parts and on the ECP5."""

FETCH_REGISTERS = 3
"""On the way of a word to the queue: the banks' addresses, their outputs, and a register more."""

QUEUE_WORDS = 8
"""Words in the queue and on their way to it: FETCH_REGISTERS + 2 or more, for a word in each clock."""


class ReadAheadRom(wiring.Component):
    """Table in block RAM whose next words wait in a short queue, read word by word, and again after the last.

    For wide and deep tables, whose block RAMs lie far from each other: registers alone drive the addresses
    and enables of the block RAMs, and a word passes one register more before it is chosen from banks of
    `bank_words`, and two after the queue. It cannot be written, as the first words of a frame are read
    before the frame comes.

    Parameters: `table`, integers (words, …), as `packed_words` takes them; `bits`, the signed width of a
    field; `bank_words`, words of a bank, a power of two.

    Members
    -------
    ready : a word is there to be taken; from a register, low in the first `start` clocks after a reset and
        high from then on
    take : a beat uses the next word; must be low while `ready` is low
    word : `word_layout` of the table

    `latency` = 2 clocks from `take` to the word at `word`. No register of a word has a clock enable.
    """

    latency = 2
    start = FETCH_REGISTERS

    def __init__(self, table: np.ndarray, bits: int, *, bank_words: int = BANK_WORDS):
        self.table, self.bits, self.bank_words = table, bits, bank_words
        super().__init__({"ready": Out(1), "take": In(1), "word": Out(word_layout(table, bits))})

    def elaborate(self, platform):
        m = Module()
        depth, words = len(self.table), packed_words(self.table, self.bits)
        width = self.word.as_value().shape().width
        m.submodules.queue = queue = SyncFIFO(width=width, depth=QUEUE_WORDS)

        # A fetch starts only while the queue has a place for its word and for all words under way. A reset
        # leaves the banks' addresses and enables as if the first fetch had just started.
        place = self.bank_words.bit_length() - 1
        under_way = Signal(range(QUEUE_WORDS + 1), init=1)
        full = Signal()
        after = (under_way + ~full - self.take)[: len(under_way)]
        fetched = Signal(FETCH_REGISTERS, init=1)
        following = Signal(range(depth), init=1 % depth)
        address = Signal(range(depth))
        m.d.sync += [
            under_way.eq(after),
            full.eq(after == QUEUE_WORDS),
            fetched.eq(Cat(~full, fetched)),
            address.eq(following),
        ]
        with m.If(~full):
            m.d.sync += following.eq(Mux(following == depth - 1, 0, following + 1))

        banks = []
        for number, first in enumerate(range(0, depth, self.bank_words)):
            own = words[first : first + self.bank_words]
            m.submodules[f"bank_{number}"] = memory = Memory(
                shape=unsigned(width), depth=len(own), init=own, attrs={"rom_style": "block"}
            )
            read = memory.read_port()
            enable = Signal(init=number == 0, name=f"enable_{number}")
            word = Signal(width, reset_less=True, name=f"word_{number}")
            m.d.comb += [read.addr.eq(address[:place]), read.en.eq(enable)]
            m.d.sync += [enable.eq(~full & (following[place:] == number)), word.eq(read.data)]
            banks.append(word)
        # The bank of the word that the banks' outputs hold, and of the one in their second registers.
        bank = address[place:]
        read_bank, passed_bank = Signal.like(bank, name="read_bank"), Signal.like(bank, name="passed_bank")
        m.d.sync += [read_bank.eq(bank), passed_bank.eq(read_bank)]

        taken = Signal(width, reset_less=True)
        output = Signal(width, reset_less=True)
        m.d.comb += [
            queue.w_data.eq(Array(banks)[passed_bank]),
            queue.w_en.eq(fetched[-1]),
            queue.r_en.eq(self.take),
            self.word.as_value().eq(output),
        ]
        with m.If(fetched[-1]):
            m.d.sync += self.ready.eq(1)
        m.d.sync += [taken.eq(queue.r_data), output.eq(taken)]
        return m
