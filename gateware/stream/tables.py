"""Per-pixel constants beside a stream: memories read in raster order, which the host may be able to write."""

from typing import NamedTuple

import numpy as np
from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out


class TableFormat(NamedTuple):
    """Format of a memory: `depth` words of `fields` signed values of `bits` bits, field 0 in the LSBs."""

    depth: int
    fields: int
    bits: int

    @property
    def signature(self) -> wiring.Signature:
        """The memory's write port, seen from the writer."""
        return wiring.Signature(
            {
                "en": Out(1),
                "addr": Out(range(self.depth)),
                "data": Out(unsigned(self.fields * self.bits)),
            }
        )


class RasterRom(wiring.Component):
    """Table in block RAM that is read word by word, one word per beat, and starts again after the last word.

    Parameters: `table`, integers (words, …) whose trailing axes are the fields of a word in C order, field 0
    in the least significant bits; `bits`, the signed width of a field.

    Members
    -------
    advance : clock enable of the pipeline beside the table
    take : a beat enters the pipeline and uses the next word; counts only while `advance` is high
    word : nested ArrayLayouts of signed(bits), of the shape of `table[0]`
    write : write port, see `TableFormat`; must not be used while a frame is being read. Only if `loadable`.

    `latency` = 2 clocks with `advance` high from `take` to the word at `word`: the memory's read register
    and its output register.
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
        """The memory's initial contents, one unsigned integer per word."""
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
    """Cut a table (rows, columns, …) into beats (rows · ceil(columns/lanes), lanes, …), padded with zeros."""
    padded = np.pad(table, [(0, 0), (0, -table.shape[1] % lanes)] + [(0, 0)] * (table.ndim - 2))
    return padded.reshape(-1, lanes, *table.shape[2:])
