"""Sums and moments of the dots' darkness in windows all over the image, while its pixels pass."""

from itertools import pairwise

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import adder_tree, tree_levels
from fastac.gateware.dots.multiple import multiple
from fastac.gateware.stream.handshake import check_lanes
from fastac.models.integer.dot_windows import CELL, DotWindows
from fastac.models.integer.words import signed_width


def window_layout(windows: DotWindows) -> data.StructLayout:
    """A window: the sum of its darkness and the moments along u and v."""
    moment = signed(windows.moment_width)
    return data.StructLayout({"mass": unsigned(windows.mass_width), "u": moment, "v": moment})


class DotWindowStream(wiring.Component):
    """Sum the darkness of frames of H × W pixels in windows, bit-exact to `windows.of_darkness(darkness)`.

    There is no frame store: a line buffer holds, for each column of cells, the upper line of the row of cells
    that is coming in and the 2 · half rows before it. Sums go down the columns first, then along the rows.

    Members
    -------
    i : stream of `lanes` values, unsigned(windows.darkness_width), in raster order
    o : stream of `per_beat` = max(1, lanes/2) windows, see `window_layout`; rows of `row_beats` beats, in
        raster order

    `latency` = 5 + 2 · ceil(log2(2 · half + 1)) clocks, without back-pressure, from the beat with a window's
    last pixel to that window: pair, cell, and down the columns as along the row a term each and its sum, with
    the row's shift register between. Initiation interval: 1 clock per beat of pixels.
    """

    multipliers = 0

    def __init__(self, windows: DotWindows, *, lanes: int):
        check_lanes(lanes)
        self.windows, self.lanes = windows, lanes
        self.count = 2 * windows.half + 1
        self.per_beat = max(1, lanes // CELL)
        self.height, self.width = windows.image
        self.line_beats = self.width // lanes
        self.row_beats = windows.shape[1] // self.per_beat
        beat = data.ArrayLayout(window_layout(windows), self.per_beat)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(unsigned(windows.darkness_width), lanes))),
                "o": Out(stream.Signature(beat)),
            }
        )

    @staticmethod
    def latency_of(half: int) -> int:
        return 5 + 2 * tree_levels(2 * half + 1)

    @property
    def latency(self) -> int:
        return self.latency_of(self.windows.half)

    def elaborate(self, platform):
        m = Module()
        half, per_beat, darkest = self.windows.half, self.per_beat, self.windows.darkest
        self._advance = advance = Signal()
        m.d.comb += [advance.eq(self.o.ready | ~self.o.valid), self.i.ready.eq(advance)]
        stage = 3 + tree_levels(self.count)  # whose registers shift along the row
        tags = self._tags(m, stage)

        # Stage 1: pairs of pixels side by side in one line of a cell: their sum, and right less left.
        dark = list(self.i.payload)
        if self.lanes == 1:
            dark.insert(0, self._register(m, dark[0], "left", tags[0].present))
        pairs = [
            (self._register(m, left + right, f"pair_{k}"), self._register(m, right - left, f"side_{k}"))
            for k, (left, right) in enumerate(zip(dark[::2], dark[1::2], strict=True))
        ]

        # Stage 2: two lines make a cell. One memory has the line above, one the earlier rows of cells.
        moment = signed(signed_width(2 * darkest))
        cell = data.StructLayout({"mass": (4 * darkest).bit_length(), "u": moment, "v": moment})
        line = data.StructLayout({"pair": pairs[0][0].shape(), "side": pairs[0][1].shape()})
        above, keep = self._line_buffer(m, "line_above", line, tags)
        past, push = self._line_buffer(m, "past_rows", data.ArrayLayout(cell, 2 * half), tags, tags[1].lower)
        rows = []
        for k, (pair, side) in enumerate(pairs):
            now = Signal(cell, name=f"cell_{k}")
            m.d.comb += [
                now.mass.eq(above[k].pair + pair),
                now.u.eq(above[k].side + side),
                now.v.eq(pair - above[k].pair),
                *(keep[k].pair.eq(pair), keep[k].side.eq(side)),
                push[k].eq(Cat(past[k], now)[cell.size :]),
            ]
            held = Signal(data.ArrayLayout(cell, self.count), reset_less=True, name=f"rows_{k}")
            with m.If(advance):
                m.d.sync += held.eq(Cat(past[k], now))
            rows.append(held)

        # Down the columns, about the middle row of cells.
        columns = []
        for k, held in enumerate(rows):
            name = f"column_{k}"
            mass, v = self._about_middle(m, [(c.mass, c.v) for c in held], 4 * darkest, 2 * darkest, name)
            u = self._sum(m, [(c.u, 2 * darkest) for c in held], f"{name}_u")
            columns.append((mass, u, v))

        # Along the row, about the middle column: the columns before are kept.
        moves = advance & tags[stage].pair
        kept = []
        for part, name in enumerate(("mass", "u", "v")):
            shape = columns[0][part].shape()
            row = Signal(data.ArrayLayout(shape, 2 * half + per_beat), reset_less=True, name=f"row_{name}")
            with m.If(moves):
                newest = Cat(column[part] for column in columns)
                m.d.sync += row.eq(Cat(row.as_value(), newest)[len(newest) :])
            kept.append(row)
        mass_bound, u_bound = 4 * darkest * self.count, 2 * darkest * self.count
        v_bound = sum(2 * darkest + 2 * CELL * abs(k - half) * 4 * darkest for k in range(self.count))
        for k in range(per_beat):
            mass, u, v = ([row[k + j] for j in range(self.count)] for row in kept)
            name, window = f"window_{k}", self.o.payload[k]
            total, along = self._about_middle(m, list(zip(mass, u, strict=True)), mass_bound, u_bound, name)
            down = self._sum(m, [(value, v_bound) for value in v], f"{name}_v")
            m.d.comb += [window.mass.eq(total), window.u.eq(along), window.v.eq(down)]
        return m

    def _tags(self, m: Module, last: int) -> list:
        """What travels with each beat, by stage up to `last`: whether it is one, completes a pair, is of the
        lower line of its cells, and its place in the line buffer. Beats that complete windows make `o` valid
        when they have passed all stages."""
        half, advance = self.windows.half, self._advance
        x = Signal(range(self.line_beats))
        y = Signal(range(self.height))
        with m.If(advance & self.i.valid):
            m.d.sync += x.eq(x + 1)
            with m.If(x == self.line_beats - 1):
                m.d.sync += [x.eq(0), y.eq(Mux(y == self.height - 1, 0, y + 1))]
        cell, ends_pair = (x[1:], x[0]) if self.lanes == 1 else (x, 1)
        tag = data.StructLayout({"present": 1, "pair": 1, "lower": 1, "cell": len(cell)})
        tags = [Signal(tag, name=f"tag_{stage}", reset_less=True) for stage in range(last + 1)]
        m.d.comb += [
            tags[0].present.eq(self.i.valid),
            tags[0].pair.eq(self.i.valid & ends_pair),
            tags[0].lower.eq(y[0]),
            tags[0].cell.eq(cell),
        ]
        valid = Signal(self.latency)
        inside = (y >= 2 * CELL * half) & (multiple(cell, self.per_beat) >= 2 * half)
        completes = tags[0].pair & tags[0].lower & inside
        m.d.comb += self.o.valid.eq(valid[-1])
        with m.If(advance):
            m.d.sync += valid.eq(Cat(completes, valid))
            m.d.sync += [after.eq(before) for before, after in pairwise(tags)]
        return tags

    def _line_buffer(self, m: Module, name: str, shape, tags: list, keeps=1) -> tuple:
        """A memory of a value of `shape` for each column of cells: those of the beat that is in stage 1, and
        what replaces them where `keeps`."""
        m.submodules[name] = buffer = memory.Memory(
            shape=data.ArrayLayout(shape, self.per_beat), depth=self.width // CELL // self.per_beat, init=[]
        )
        read, write = buffer.read_port(), buffer.write_port()
        m.d.comb += [
            *(read.addr.eq(tags[0].cell), read.en.eq(self._advance)),
            *(write.addr.eq(tags[1].cell), write.en.eq(self._advance & tags[1].pair & keeps)),
        ]
        return read.data, write.data

    def _register(self, m: Module, value, name: str, enable=1) -> Signal:
        held = Signal(value.shape(), reset_less=True, name=name)
        with m.If(self._advance & enable):
            m.d.sync += held.eq(value)
        return held

    def _sum(self, m: Module, terms: list, name: str) -> Signal:
        """The sum of (term, largest magnitude), each held for a clock before."""
        held = [self._register(m, term, f"{name}_{k}") for k, (term, _) in enumerate(terms)]
        return adder_tree(m, self._advance, held, np.array([[bound for _, bound in terms]]), name)

    def _about_middle(self, m: Module, cells: list, mass_bound: int, moment_bound: int, name: str):
        """Of (mass, moment) at places CELL px apart: the masses' sum and their moment about the middle."""
        distances = [2 * CELL * (k - self.windows.half) for k in range(self.count)]
        terms = [
            (moment + multiple(mass, distance), moment_bound + abs(distance) * mass_bound)
            for distance, (mass, moment) in zip(distances, cells, strict=True)
        ]
        total = self._sum(m, [(mass, mass_bound) for mass, _ in cells], f"{name}_mass")
        return total, self._sum(m, terms, f"{name}_moment")
