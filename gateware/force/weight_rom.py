# amaranth: UnusedElaboratable=no
"""The weights of a frame in block RAM, a word a beat, each weight of the bits that its own values need."""

import numpy as np
from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.force.block_address import BlockAddress
from fastac.models.integer.words import signed_width


class WeightRom(wiring.Component):
    """Table in block RAM that is read a word a beat, and starts again after a frame's last one.

    Parameters: `table`, integers (words, fields). In the memory a field has the bits that its own values
    need, so a word has Σ `field_widths` bits: of 36-Kbit blocks they take about words · bits · 8/9 / 2**15.
    `squares`, where words count for squares of pixels, says which word a beat uses; without it each is used
    once.

    Members
    -------
    advance : clock enable of the pipeline beside the table
    take : a beat enters the pipeline and uses the next word; counts only while `advance` is high
    word : the fields, signed(width) each
    last : the beat that `take` takes is the frame's last

    `latency` = 2 clocks with `advance` high from `take` to the word at `word`: the memory's read register
    and its output register.
    """

    latency = 2

    def __init__(self, table: np.ndarray, squares: BlockAddress | None = None):
        if squares is not None and squares.words != len(table):
            raise ValueError(f"table of {len(table)} words: expected {squares.words}")
        self.table, self.squares = table, squares
        fields = table.shape[1]
        self.width = max(self.field_widths)
        super().__init__(
            {
                "advance": In(1),
                "take": In(1),
                "word": Out(data.ArrayLayout(signed(self.width), fields)),
                "last": Out(1),
            }
        )

    @property
    def field_widths(self) -> list[int]:
        bounds = np.where(self.table < 0, ~self.table, self.table).max(axis=0)
        return [signed_width(int(bound)) for bound in bounds]

    def _words(self) -> list[int]:
        """The memory's contents, one unsigned integer a pixel, field 0 in the least significant bits."""
        fields = zip(self.table.T.astype(np.int64), self.field_widths, strict=True)
        ones = np.concatenate([(field[:, None] >> np.arange(width)) & 1 for field, width in fields], axis=1)
        octets = np.packbits(ones.astype(np.uint8), axis=1, bitorder="little")
        return [int.from_bytes(word.tobytes(), "little") for word in octets]

    def elaborate(self, platform):
        m = Module()
        depth, words = len(self.table), self._words()
        if self.squares is not None:
            m.submodules.squares = squares = self.squares
            address = squares.address
            m.d.comb += [squares.take.eq(self.advance & self.take), self.last.eq(squares.last)]
        else:
            address = Signal(range(depth))
            m.d.comb += self.last.eq(address == depth - 1)
            with m.If(self.advance & self.take):
                m.d.sync += address.eq(Mux(self.last, 0, address + 1))

        m.submodules.memory = memory = Memory(
            shape=unsigned(sum(self.field_widths)), depth=depth, init=words, attrs={"rom_style": "block"}
        )
        read = memory.read_port()
        output = Signal(read.data.shape(), reset_less=True)
        m.d.comb += [read.addr.eq(address), read.en.eq(self.advance & self.take)]
        with m.If(self.advance):
            m.d.sync += output.eq(read.data)
        low = 0
        for field, width in zip(self.word, self.field_widths, strict=True):
            m.d.comb += field.eq(output[low : low + width].as_signed())
            low += width
        return m
