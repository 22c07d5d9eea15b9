"""Constants beside a stream: memories of values or of records, which the host may be able to write."""

from typing import NamedTuple

import numpy as np
from amaranth import Const, Module, Mux, Shape, Signal, signed, unsigned
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


FIELD_BITS = 32
"""A calibration image has so many bits for each field of a table."""


class RecordTable:
    """Records of a layout in a memory, which the host may be able to write.

    Parameters: the layout, and the initial records, each as {name: integer}.

    format : each record is cut into as few fields as a calibration image allows, the first in the LSBs
    values : the initial records as these fields, (depth, fields)
    """

    def __init__(self, layout: data.StructLayout, records: list[dict[str, int]]):
        self.layout, self.records = layout, records
        fields = 1 << (-(-layout.size // FIELD_BITS) - 1).bit_length()
        self.format = TableFormat(len(records), fields, -(-layout.size // fields))

    @property
    def values(self) -> np.ndarray:
        bits, fields = self.format.bits, self.format.fields
        words = [Const.cast(self.layout.const(record)).value for record in self.records]
        cut = [[word >> (k * bits) & ((1 << bits) - 1) for k in range(fields)] for word in words]
        values = np.array(cut, np.int64)
        return values - (values >> (bits - 1) << bits)

    def memory(self, m: Module, name: str, write=None) -> Memory:
        """The memory as submodule `name`; `write` is its write port where the host can write it."""
        m.submodules[name] = memory = Memory(shape=self.layout, depth=len(self.records), init=self.records)
        if write is not None:
            port = memory.write_port()
            m.d.comb += [
                port.en.eq(write.en),
                port.addr.eq(write.addr),
                port.data.eq(write.data[: self.layout.size]),
            ]
        return memory


def word_layout(table: np.ndarray, bits: int) -> data.Layout | Shape:
    """Nested ArrayLayouts of signed(bits), of the shape of `table[0]`."""
    layout = signed(bits)
    for fields in reversed(table.shape[1:]):
        layout = data.ArrayLayout(layout, fields)
    return layout


def packed_words(table: np.ndarray, bits: int) -> list[int]:
    """The words of a table (words, …) of signed fields of `bits`, one unsigned integer each.

    The trailing axes are the fields of a word in C order, field 0 in the least significant bits.
    """
    fields = table.reshape(len(table), -1, 1).astype(np.int64)
    ones = (fields >> np.arange(bits)) & 1
    octets = np.packbits(ones.astype(np.uint8).reshape(len(fields), -1), axis=1, bitorder="little")
    return [int.from_bytes(word.tobytes(), "little") for word in octets]


class RasterRom(wiring.Component):
    """Table in block RAM that is read word by word, one word per beat, and starts again after the last word.

    Parameters: `table`, integers (words, …), as `packed_words` takes them; `bits`, the signed width of a
    field.

    Members
    -------
    advance : clock enable of the pipeline beside the table
    take : a beat enters the pipeline and uses the next word; counts only while `advance` is high
    word : `word_layout` of the table
    write : write port, see `TableFormat`; must not be used while a frame is being read. Only if `loadable`.

    `latency` = 2 clocks, of those with `advance` high, from `take` to the word at `word`: the memory's read
    register and its output register.
    """

    latency = 2

    def __init__(self, table: np.ndarray, bits: int, *, loadable: bool = False):
        self.table, self.bits, self.loadable = table, bits, loadable
        members = {"advance": In(1), "take": In(1), "word": Out(word_layout(table, bits))}
        if loadable:
            members["write"] = In(TableFormat(len(table), table[0].size, bits).signature)
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        depth = len(self.table)
        m.submodules.memory = memory = Memory(
            shape=unsigned(self.word.as_value().shape().width),
            depth=depth,
            init=packed_words(self.table, self.bits),
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
