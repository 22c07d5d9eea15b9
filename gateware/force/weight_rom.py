# amaranth: UnusedElaboratable=no
"""The weights of a frame in block RAM, a word a pixel, in columns that fill the blocks."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.models.integer.words import signed_width

BLOCK_WORDS = {1: 1 << 14, 2: 1 << 13, 4: 1 << 12, 9: 1 << 11, 18: 1 << 10, 36: 1 << 9}
"""Words of an 18-Kbit block RAM by their width: from 9 bits on they have parity bits (Xilinx UG473, UG573)."""


def blocks_of(depth: int, columns: list[int]) -> int:
    """18-Kbit block RAMs of a table of `depth` words that is cut into columns of these widths; a 36-Kbit block
    is two of them.

    A column takes ceil(column/width) · ceil(depth/words) blocks of words of the width that is best for it.
    """
    return sum(
        min(-(-column // width) * -(-depth // words) for width, words in BLOCK_WORDS.items())
        for column in columns
    )


def columns_of(depth: int, width: int) -> list[int]:
    """Widths of the columns that a table of `width` bits is best cut into, from its least significant bit.

    Only words of 9 bits and multiples use the parity bits. So one column has all the nines, and columns of
    4, 2 and 1 bits have what is left, where that takes fewer blocks than the whole in one.
    """
    nines, left = divmod(width, 9)
    cut = [9 * nines] * (nines > 0) + [bits for bits in (4, 2, 1) if left & bits]
    return cut if left < 8 and blocks_of(depth, cut) < blocks_of(depth, [width]) else [width]


class WeightRom(wiring.Component):
    """Table in block RAM that is read a word a pixel, and starts again after the last one.

    Parameters: `table`, integers (pixels, fields). A field has the bits that its own values need, and the
    memory is cut into `columns`.

    Members
    -------
    advance : clock enable of the pipeline beside the table
    take : a pixel enters the pipeline and uses the next word; counts only while `advance` is high
    word : the fields, signed(width) each
    last : the word that `take` uses is the frame's last

    `latency` = 2 clocks with `advance` high from `take` to the word at `word`: the memory's read register
    and its output register.
    """

    latency = 2

    def __init__(self, table: np.ndarray):
        self.table = table
        fields = table.shape[1]
        self.width = signed_width(int(np.abs(table).max()))
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
        return [signed_width(int(bound)) for bound in np.abs(self.table).max(axis=0)]

    @property
    def columns(self) -> list[int]:
        return columns_of(len(self.table), sum(self.field_widths))

    def _words(self) -> list[int]:
        """The memory's contents, one unsigned integer a pixel, field 0 in the least significant bits."""
        fields = zip(self.table.T.astype(np.int64), self.field_widths, strict=True)
        ones = np.concatenate([(field[:, None] >> np.arange(width)) & 1 for field, width in fields], axis=1)
        octets = np.packbits(ones.astype(np.uint8), axis=1, bitorder="little")
        return [int.from_bytes(word.tobytes(), "little") for word in octets]

    def elaborate(self, platform):
        m = Module()
        depth, words = len(self.table), self._words()
        address = Signal(range(depth))
        m.d.comb += self.last.eq(address == depth - 1)
        with m.If(self.advance & self.take):
            m.d.sync += address.eq(Mux(self.last, 0, address + 1))

        low, outputs = 0, []
        for k, width in enumerate(self.columns):
            m.submodules[f"column_{k}"] = memory = Memory(
                shape=unsigned(width),
                depth=depth,
                init=[word >> low & ((1 << width) - 1) for word in words],
                attrs={"rom_style": "block"},
            )
            read = memory.read_port()
            output = Signal(width, reset_less=True, name=f"output_{k}")
            m.d.comb += [read.addr.eq(address), read.en.eq(self.advance & self.take)]
            with m.If(self.advance):
                m.d.sync += output.eq(read.data)
            outputs.append(output)
            low += width
        whole, low = Cat(outputs), 0
        for field, width in zip(self.word, self.field_widths, strict=True):
            m.d.comb += field.eq(whole[low : low + width].as_signed())
            low += width
        return m
