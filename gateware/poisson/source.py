"""The source (right-hand side) of the Poisson equation: divergence of the slopes minus a stored offset."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.tables import TableFormat
from fastac.models.integer.laplacian import STENCILS
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import signed_width


class PoissonSourceStream(wiring.Component):
    """Compute the source for the inner pixels of frames of `height` × `width` slopes, bit-exact to `source`.

    One line buffer holds what the divergence needs of earlier rows: for the central one a row of p and two of
    q, for the backward one a row of q. Inner columns count from the left, so lane 0 of a row's first beat is
    image column 1.

    Members
    -------
    i : stream of `lanes` slopes (p, q), 2 × signed(source.gradient_width), in raster order
    o : stream of `lanes` sources, signed(source.width): height − 2 rows of `beats` = ceil((width − 2)/lanes)
    offset : write port of the offsets' memory, one word per beat, see `TableFormat`; must not be used while a
        frame is in flight. Only with `loadable`; the memory then holds any offset of signed(source.width).

    The lanes beyond width − 2 in a row's last beat are undefined. Initiation interval: 1 clock per beat.
    `latency` = 5 clocks, without back-pressure, from the input beat with the last slope that an output beat
    needs to that output beat; with 4 lanes a row's last output beat comes one clock after the one before it.
    `delay` counts from a frame's first input beat.
    """

    latency = 5

    def __init__(self, source: PoissonSource, *, height: int, width: int, lanes: int, loadable: bool = False):
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if width % lanes or width < max(4, 2 * lanes):
            raise ValueError(f"width {width}: expected a multiple of lanes = {lanes}, of at least two beats")
        if source.offset.shape != (height - 2, width - 2):
            raise ValueError(f"offset {source.offset.shape}: expected {(height - 2, width - 2)}")
        self.source, self.height, self.width, self.lanes = source, height, width, lanes
        self.beats = -(-(width - 2) // lanes)
        self.span = STENCILS[source.divergence].span
        self.rows_ahead, self.beats_ahead = self.ahead(source.divergence, lanes)
        own_bits = signed_width(int(np.abs(source.offset).max()))
        self.loadable = loadable
        self.table = TableFormat((height - 2) * self.beats, lanes, source.width if loadable else own_bits)
        slope = signed(source.gradient_width)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(data.ArrayLayout(slope, 2), lanes))),
            "o": Out(stream.Signature(data.ArrayLayout(signed(source.width), lanes))),
        }
        if loadable:
            members["offset"] = In(self.table.signature)
        super().__init__(members)

    @property
    def table_values(self) -> np.ndarray:
        """The offsets in beat order, (beats, lanes); unused lanes are zero."""
        short = self.beats * self.lanes - (self.width - 2)
        return np.pad(self.source.offset, ((0, 0), (0, short))).reshape(-1, self.lanes)

    @staticmethod
    def ahead(divergence: str, lanes: int) -> tuple[int, int]:
        """Look-ahead: rows and beats of slopes after its own position that a beat of sources needs."""
        span = STENCILS[divergence].span
        return span, -(-span // lanes)

    @classmethod
    def delay_of(cls, row: int, beat: int, *, width: int, lanes: int, divergence: str, fold: int = 1) -> int:
        """`delay` with a beat every `fold` clocks, for images of `width` pixels, without building it."""
        rows, beats = cls.ahead(divergence, lanes)
        return ((row + rows) * (width // lanes) + beat + beats) * fold + cls.latency

    def delay(self, row: int, beat: int) -> int:
        """Clocks from a frame's first input beat to output `beat` of inner `row`, without back-pressure."""
        return self.delay_of(row, beat, width=self.width, lanes=self.lanes, divergence=self.source.divergence)

    def elaborate(self, platform):
        m = Module()
        slope, lanes = signed(self.source.gradient_width), self.lanes
        row_beats = self.width // lanes
        advance = Signal()
        m.d.comb += [advance.eq(self.o.ready | ~self.o.valid), self.i.ready.eq(advance)]

        # Stage 1: the beat of slopes and, from the line buffer, earlier rows of its columns.
        x = Signal(range(row_beats))
        y = Signal(range(self.height))
        with m.If(advance & self.i.valid):
            m.d.sync += x.eq(x + 1)
            with m.If(x == row_beats - 1):
                m.d.sync += [x.eq(0), y.eq(Mux(y == self.height - 1, 0, y + 1))]
        past = data.StructLayout(
            {"p": slope, "q": slope, "q_before": slope} if self.span == 2 else {"q": slope}
        )
        m.submodules.rows = rows = memory.Memory(
            shape=data.ArrayLayout(past, lanes), depth=row_beats, init=[]
        )
        read, write = rows.read_port(), rows.write_port()
        slopes = Signal(self.i.payload.shape(), reset_less=True)
        m.d.comb += [read.addr.eq(x), read.en.eq(advance)]

        # Input positions that complete an output beat; `trails`: one more after a row's last input.
        inner = (y >= self.rows_ahead) & (y < self.height - 2 + self.rows_ahead)
        completes = inner & (x >= self.beats_ahead) & (x < self.beats + self.beats_ahead)
        trails = inner & (x == row_beats - 1) & (self.beats + self.beats_ahead > row_beats)
        present = Signal()
        complete = Signal()
        trailing = Signal()
        late = Signal()
        valid = Signal(self.latency - 1)
        m.d.comb += self.o.valid.eq(valid[-1])
        with m.If(advance):
            m.d.sync += [
                slopes.eq(self.i.payload),
                write.addr.eq(x),
                present.eq(self.i.valid),
                complete.eq(self.i.valid & completes),
                trailing.eq(self.i.valid & trails),
                late.eq(trailing),
                valid.eq(Cat(complete | late, valid)),
            ]

        # Stage 2: each column's p in the source's row, and its difference of q across that row. The window
        # keeps the previous columns for the differences of p along the row; the line buffer is updated.
        column = data.StructLayout({"p": slope, "dq": signed(slope.width + 1)})
        newest = Signal(data.ArrayLayout(column, lanes))
        window = Signal(data.ArrayLayout(column, lanes * (self.beats_ahead + 1)), reset_less=True)
        m.d.comb += write.en.eq(advance & present)
        for lane in range(lanes):
            p, q = slopes[lane]
            before, now = read.data[lane], write.data[lane]
            m.d.comb += now.q.eq(q)
            if self.span == 2:
                m.d.comb += [now.p.eq(p), now.q_before.eq(before.q)]
                m.d.comb += [newest[lane].p.eq(before.p), newest[lane].dq.eq(q - before.q_before)]
            else:
                m.d.comb += [newest[lane].p.eq(p), newest[lane].dq.eq(q - before.q)]
        with m.If(advance & (present | late)):
            m.d.sync += window.eq(Cat(window, newest)[len(newest.as_value()) :])

        # Stage 3: differences and offset. Stage 4: divergence. Stage 5: source.
        offset = signed(self.table.bits)
        m.submodules.table = table = memory.Memory(
            shape=data.ArrayLayout(offset, lanes), depth=self.table.depth, init=self.table_values.tolist()
        )
        words = table.read_port()
        if self.loadable:
            port = table.write_port()
            m.d.comb += [
                port.en.eq(self.offset.en),
                port.addr.eq(self.offset.addr),
                port.data.eq(self.offset.data),
            ]
        beat = Signal(range(self.table.depth))
        m.d.comb += [words.addr.eq(beat), words.en.eq(advance)]
        with m.If(advance & valid[0]):
            m.d.sync += beat.eq(Mux(beat == self.table.depth - 1, 0, beat + 1))
        for lane in range(lanes):
            dp = Signal(signed(slope.width + 1), reset_less=True, name=f"dp_{lane}")
            dq = Signal(signed(slope.width + 1), reset_less=True, name=f"dq_{lane}")
            divergence = Signal(signed(slope.width + 2), reset_less=True, name=f"divergence_{lane}")
            known = Signal(offset, reset_less=True, name=f"offset_{lane}")
            right = window[lane + self.span]
            with m.If(advance):
                m.d.sync += [
                    dp.eq(right.p - window[lane].p),
                    dq.eq(window[lane + 1].dq),
                    divergence.eq(dp + dq),
                    known.eq(words.data[lane]),
                    self.o.payload[lane].eq(divergence - known),
                ]
        return m
