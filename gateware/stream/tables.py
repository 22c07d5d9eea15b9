"""Tables beside a stream: ROMs read in raster order, and write ports for the host."""

from typing import NamedTuple

import numpy as np
from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out


class TableFormat(NamedTuple):
    """A memory of `depth` words of `fields` signed values of `bits`, field 0 lowest."""

    depth: int
    fields: int
    bits: int

    @property
    def signature(self) -> wiring.Signature:
        """Its write port, seen from the side that writes."""
        return wiring.Signature(
            {
                "en": Out(1),
                "addr": Out(range(self.depth)),
                "data": Out(unsigned(self.fields * self.bits)),
            }
        )


class RasterRom(wiring.Component):
    """A table read in raster order, one word a beat, in block RAM; after the last word the first follows.

    Parameters: `table`, integers (words, …) whose last axes are the fields of a word, C order, field 0
    lowest; `bits`, the signed width of a field.

    Members
    -------
    advance : the pipeline around the table moves
    take : the beat that enters the pipeline consumes a word
    word : nested ArrayLayouts of signed(bits), of the shape of `table[0]`
    write : write port, not to be used while a table is read; see `TableFormat`. Only if `loadable`.

    The word of a taken beat stands in `word` after `latency` = 2 advances: the memory's read, and its
    output register.
    """

    latency = 2

    def __init__(self, table: np.ndarray, bits: int, *, loadable: bool = False):
        self.table, self.bits, self.loadable = table, bits, loadable
        layout = signed(bits)
        for fields in reversed(table.shape[1:]):
            layout = data.ArrayLayout(layout, fields)
        members = {"advance": In(1), "take": In(1), "word": Out(layout)}
        if loadable:
            members["write"] = In(TableFormat(len(table), table[0].size, bits).signature)
        super().__init__(members)

    @property
    def words(self) -> list[int]:
        """The memory's contents, one unsigned integer a word."""
        fields = self.table.reshape(len(self.table), -1, 1).astype(np.int64)
        ones = (fields >> np.arange(self.bits)) & 1
        octets = np.packbits(ones.astype(np.uint8).reshape(len(fields), -1), axis=1, bitorder="little")
        return [int.from_bytes(word.tobytes(), "little") for word in octets]

    def elaborate(self, platform):
        m = Module()
        depth = len(self.table)
        m.submodules.memory = memory = Memory(
            shape=unsigned(self.word.as_value().shape().width),
            depth=depth,
            init=self.words,
            attrs={"ram_style" if self.loadable else "rom_style": "block"},
        )
        read = memory.read_port()
        if self.loadable:
            port = memory.write_port()
            m.d.comb += [
                port.en.eq(self.write.en),
                port.addr.eq(self.write.addr),
                port.data.eq(self.write.data),
            ]
        address = Signal(range(depth))
        output = Signal(read.data.shape(), reset_less=True)
        m.d.comb += [
            read.addr.eq(address),
            read.en.eq(self.advance & self.take),
            self.word.as_value().eq(output),
        ]
        with m.If(self.advance):
            m.d.sync += output.eq(read.data)
            with m.If(self.take):
                m.d.sync += address.eq(Mux(address == depth - 1, 0, address + 1))
        return m


def raster_beats(table: np.ndarray, lanes: int) -> np.ndarray:
    """A table (rows, columns, …) to beats (rows · ceil(columns/lanes), lanes, …); void lanes are zero."""
    padded = np.pad(table, [(0, 0), (0, -table.shape[1] % lanes)] + [(0, 0)] * (table.ndim - 2))
    return padded.reshape(-1, lanes, *table.shape[2:])
