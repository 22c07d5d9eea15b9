"""Memories of the operands of shared multipliers: a word for each clock of a pixel."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from amaranth import Module, Shape, Signal, Value, unsigned
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import Out

from fastac.gateware.stream.tables import TableFormat


class Column(NamedTuple):
    """An operand's values in the clocks of a pixel, or its only value for all of them."""

    shape: Shape
    values: tuple[int, ...]


def format_of(columns: Sequence[Column], fold: int) -> TableFormat:
    """Format of all columns as one table: column c from word c · fold on, a value a word."""
    bits = max(column.shape.width + (not column.shape.signed) for column in columns)
    return TableFormat(len(columns) * fold, 1, bits)


def values_of(columns: Sequence[Column], fold: int) -> np.ndarray:
    """The columns' values as one table, (len(columns) · fold, 1), the last repeated for further clocks."""
    table = np.zeros((len(columns), fold), np.int64)
    for row, column in zip(table, columns, strict=True):
        row[:] = column.values[-1]
        row[: len(column.values)] = column.values
    return table.reshape(-1, 1)


def write_signature(columns: Sequence[Column], fold: int) -> wiring.Signature:
    """Write port of columns, seen from the writer: an enable for each, and a row and a value for all."""
    return wiring.Signature(
        {
            "en": Out(len(columns)),
            "row": Out(range(fold)),
            "data": Out(format_of(columns, fold).bits),
        }
    )


def columns_reader(m: Module, columns: Sequence[Column], write=None) -> Callable[[int, Value], Value]:
    """A function of a column's number and a row that adds the column to `m` and returns that row's value.

    write : its write port where the host can write it; must not be used while a pixel is in flight
    """

    def read(number: int, row: Value) -> Value:
        shape, values = columns[number]
        if len(values) == 1:
            only = Signal(shape, init=values[0], reset_less=True, name=f"column_{number}")
            if write is not None:
                with m.If(write.en[number]):
                    m.d.sync += only.eq(write.data[: shape.width])
            return only
        mask = (1 << shape.width) - 1
        depth = 1 << len(row)
        m.submodules[f"column_{number}"] = memory = Memory(
            shape=unsigned(shape.width),
            depth=depth,
            init=[value & mask for value in values] + [0] * (depth - len(values)),
            attrs={} if write is None else {"ram_style": "distributed"},
        )
        port = memory.read_port(domain="comb")
        m.d.comb += port.addr.eq(row)
        if write is not None:
            into = memory.write_port()
            m.d.comb += [
                into.en.eq(write.en[number]),
                into.addr.eq(write.row),
                into.data.eq(write.data[: shape.width]),
            ]
        return port.data.as_signed() if shape.signed else port.data

    return read


def row_counter(m: Module, begins: Value, fold: int, name: str) -> Signal:
    """A count of the clocks of a pixel: 0 in the clock after `begins`, then on, modulo `fold`."""
    row = Signal(range(fold), reset_less=True, name=name)
    m.d.sync += row.eq(row + 1)
    with m.If(begins):
        m.d.sync += row.eq(0)
    return row
