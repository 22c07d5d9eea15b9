"""Constants in block RAM beside a stream, read a beat ahead, so that a word has a clock more to travel in."""

import numpy as np
from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib.memory import Memory

from fastac.gateware.stream.tables import RasterRom


class ReadAheadRom(RasterRom):
    """Table in block RAM that holds the next beat's word ready, read word by word, and again after the last.

    For wide tables, whose block RAMs lie far from each other: after the memory's own register a word passes
    two more on its way to the multipliers, at the latency of `RasterRom`, which has one. It cannot be
    written, as the first word of a frame is read before the frame comes.

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
        m.submodules.memory = memory = Memory(
            shape=unsigned(self.word.as_value().shape().width),
            depth=depth,
            init=self.words,
            attrs={"rom_style": "block"},
        )
        read = memory.read_port()
        holds_word, address = Signal(), Signal(range(depth))
        m.d.comb += [read.addr.eq(address), read.en.eq(self.take | ~holds_word)]
        m.d.sync += holds_word.eq(1)
        with m.If(read.en):
            m.d.sync += address.eq(Mux(address == depth - 1, 0, address + 1))

        word = read.data
        for register in range(self.latency):
            passed = Signal(word.shape(), reset_less=True, name=f"word_{register}")
            m.d.sync += passed.eq(word)
            word = passed
        m.d.comb += self.word.as_value().eq(word)
        return m
