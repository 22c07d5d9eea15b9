"""Which marker dots are in contact: the displacement at each dot's place at rest against a threshold."""

import numpy as np
from amaranth import Array, Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_lanes
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.dot_spread import DotSpread


class DotContact(wiring.Component):
    """One bit for each dot of a frame: the displacement at its place is beyond the threshold.

    Members
    -------
    i : stream of `lanes` displacements of `word` each; a frame is `rows` rows of ceil(rows/lanes) beats, the
        last row first if `rows_reversed`
    o : stream of one beat per frame, M bits; bit k belongs to dot `order[k]`
    write : write port of the dots' places in the frame, see `table`; must not be used while a frame is in
        flight. Only if `loadable`.

    `latency` = 1 clock from a frame's last beat; initiation interval 1. Raises ValueError for two dots in one
    beat.
    """

    latency = 1

    def __init__(self, spread: DotSpread, word, *, rows: int, lanes: int, rows_reversed: bool):
        check_lanes(lanes)
        self.spread, self.rows, self.lanes = spread, rows, lanes
        self.row_beats = -(-rows // lanes)
        column, row = spread.place.T
        beat = (rows - 1 - row if rows_reversed else row) * self.row_beats + column // lanes
        self.order = np.argsort(beat, kind="stable")
        """The dots as they come by."""
        self.beat, self.lane = beat[self.order], (column % lanes)[self.order]
        together = np.flatnonzero(np.diff(self.beat) == 0)
        if len(together):
            u, v = spread.place[self.order[together[0]]] + 1
            raise ValueError(f"dot at {u}, {v} px: another is in the same beat of {lanes} pixels")
        self.loadable = spread.side is not None
        self.table = RecordTable(*self._records())
        members = {
            "i": In(stream.Signature(data.ArrayLayout(word, lanes))),
            "o": Out(stream.Signature(len(self.order))),
        }
        if self.loadable:
            members["write"] = In(self.table.format.signature)
        super().__init__(members)

    def _records(self) -> tuple[data.StructLayout, list[dict]]:
        """The layout of a dot's place, and the places in `order`; the last is that of no beat."""
        beats = self.rows * self.row_beats
        lane_bits = max(1, (self.lanes - 1).bit_length())
        layout = data.StructLayout({"beat": unsigned(beats.bit_length()), "lane": unsigned(lane_bits)})
        return layout, [
            {"beat": int(b), "lane": int(k)}
            for b, k in zip([*self.beat, beats], [*self.lane, 0], strict=True)
        ]

    def elaborate(self, platform):
        m = Module()
        count, beats = len(self.order), self.rows * self.row_beats
        places = self.table.memory(m, "places", self.write if self.loadable else None)
        table = places.read_port(domain="comb")
        index, beat = Signal(range(count + 1)), Signal(range(beats))
        place, touches = table.data, Signal()
        taken, here, last = Signal(), Signal(), Signal()
        displacement = Array(self.i.payload[k] for k in range(self.lanes))[place.lane]
        m.d.comb += [
            table.addr.eq(index),
            self.i.ready.eq(~self.o.valid | self.o.ready),
            taken.eq(self.i.valid & self.i.ready),
            here.eq(taken & (beat == place.beat)),
            last.eq(taken & (beat == beats - 1)),
            touches.eq(displacement > self.spread.threshold),
        ]
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.If(taken):
            m.d.sync += beat.eq(Mux(last, 0, beat + 1))
        with m.If(here):
            m.d.sync += [self.o.payload.eq(Cat(self.o.payload[1:], touches)), index.eq(index + 1)]
        with m.If(last):
            m.d.sync += [self.o.valid.eq(1), index.eq(0)]
        return m
