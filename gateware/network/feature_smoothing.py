# amaranth: UnusedElaboratable=no
"""The mean of ΔI over a square window around each pixel, between background subtraction and network."""

from itertools import pairwise

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import adder_tree, tree_levels
from fastac.gateware.stream.handshake import check_fold, check_lanes, pace
from fastac.models.integer import smoothing
from fastac.models.integer.features import WIDTH

DISTRIBUTED_BEATS = 64
"""Beats of a row up to which rows are kept in look-up tables; a block RAM is deeper and has fewer bits."""


class FeatureSmoothing(wiring.Component):
    """Average the differences from the background over a window, bit-exact to `smoothing.smoothed`.

    Parameters: `window_px`, the window's side, one of `smoothing.WINDOWS_PX`; `coordinate_u` (width,) and
    `coordinate_v` (height,), the codes of a pixel's column and row; `fold`, the fewest clocks from beat to
    beat.

    Members
    -------
    i : stream of `lanes` feature vectors of channels + 2 values, signed(9) each, whole frames in raster
        order; its coordinates are not looked at
    o : the same stream, with means in place of the differences, and the coordinates of their pixels

    A memory holds the `window_px` rows before the one that comes in. The sum over rows is taken first, then
    that over columns; beyond the image its outermost pixels go on.

    All registers move by steps, one for each beat that comes in. Between frames steps are taken without a
    beat, so that a frame's last `delay` steps need no next frame; once it has begun, they need its beats.
    `latency` = `delay` · fold + 1 clocks from a beat at `i` to the same beat at `o`, while beats come `fold`
    clocks apart and `o` is ready; initiation interval: `fold` clocks a beat, also from frame to frame.
    """

    def __init__(
        self,
        window_px: int,
        channels: int,
        coordinate_u: np.ndarray,
        coordinate_v: np.ndarray,
        *,
        lanes: int,
        fold: int = 1,
    ):
        check_lanes(lanes)
        check_fold(fold, lanes)
        self.width, self.height = len(coordinate_u), len(coordinate_v)
        if window_px not in smoothing.WINDOWS_PX:
            raise ValueError(f"window_px {window_px}: expected one of {smoothing.WINDOWS_PX}")
        if self.width % lanes or self.width < 2 * lanes:
            raise ValueError(f"width {self.width}: expected a multiple of {lanes} lanes, {2 * lanes} or more")
        if self.height <= window_px // 2:
            raise ValueError(f"height {self.height}: expected more than half the window, {window_px // 2}")
        self.window_px, self.channels, self.lanes, self.fold = window_px, channels, lanes, fold
        self.coordinate_u, self.coordinate_v = np.array(coordinate_u), np.array(coordinate_v)
        self.half, self.beats = window_px // 2, self.width // lanes
        self.reach, self.levels = -(-self.half // lanes), tree_levels(window_px + 1)
        layout = data.ArrayLayout(data.ArrayLayout(signed(WIDTH), channels + 2), lanes)
        super().__init__({"i": In(stream.Signature(layout)), "o": Out(stream.Signature(layout))})

    @staticmethod
    def delay_of(window_px: int, width: int, lanes: int) -> int:
        """Steps from a beat's own to the one that puts its means out: half a window of rows and of columns,
        and registers: rows, choice of rows, their sum, choice of columns, their sum, output."""
        half = window_px // 2
        return half * (width // lanes) + -(-half // lanes) + 2 * tree_levels(window_px + 1) + 3

    @classmethod
    def latency_of(cls, window_px: int, width: int, lanes: int, fold: int = 1) -> int:
        return cls.delay_of(window_px, width, lanes) * fold + 1

    @property
    def latency(self) -> int:
        return self.latency_of(self.window_px, self.width, self.lanes, self.fold)

    def elaborate(self, platform):
        m = Module()
        step, room, pending = Signal(), Signal(), Signal()
        due = pace(m, step, self.fold)
        within = self._frame_under_way(m, step & self.i.valid)
        m.d.comb += [
            room.eq(self.o.ready | ~self.o.valid),
            self.i.ready.eq(room & due),
            step.eq(room & due & (self.i.valid | (pending & ~within))),
        ]
        # Where the pixels are whose means are due: in the middle of the rows, and of the columns, and summed.
        middle = 1 + self.levels + self.reach
        places = self._places(m, step, step & self.i.valid & ~within, steps=middle + 1 + self.levels)
        # A frame that has entered whole has its first beat among them, as it is longer than half a window.
        m.d.comb += pending.eq(Cat(place.valid for place in places).any())

        sums = self._row_sums(m, step, self._rows(m, step), places[0].row)
        beats = [sums]  # the newest first
        for k in range(2 * self.reach):
            beats.append(
                [Signal.like(value, reset_less=True, name=f"beat{k}_{n}") for n, value in enumerate(sums)]
            )
            with m.If(step):
                m.d.sync += [new.eq(old) for new, old in zip(beats[-1], beats[-2], strict=True)]
        totals = self._column_sums(m, step, beats, places[middle].beat)

        codes = self._codes(m, step, places[-2])
        means = Signal(self.o.payload.shape(), reset_less=True)
        m.d.comb += self.o.payload.eq(means)
        bits = smoothing.shift(self.window_px)
        with m.If(room):
            m.d.sync += self.o.valid.eq(step & places[-1].valid)
        with m.If(step):
            for lane in range(self.lanes):
                for c in range(self.channels):
                    total = totals[lane * self.channels + c]
                    m.d.sync += means[lane][c].eq((total + (1 << (bits - 1))) >> bits)
                m.d.sync += [
                    means[lane][self.channels].eq(codes[0][lane]),
                    means[lane][self.channels + 1].eq(codes[1]),
                ]
        return m

    def _frame_under_way(self, m: Module, enters) -> Signal:
        """High from the step after a frame's first beat to the one of its last."""
        count = self.height * self.beats
        entered = Signal(range(count))
        within = Signal()
        m.d.comb += within.eq(entered != 0)
        with m.If(enters):
            m.d.sync += entered.eq(Mux(entered == count - 1, 0, entered + 1))
        return within

    def _places(self, m: Module, step, begins, *, steps: int) -> list[data.View]:
        """The place of the beat in the middle of the rows, and of those 1 to `steps` steps before it."""
        layout = data.StructLayout({"valid": 1, "row": range(self.height), "beat": range(self.beats)})
        places = [Signal(layout, name=f"place_{k}") for k in range(steps + 1)]
        left = Signal(range(self.half * self.beats + 1))  # steps until the frame's first beat is there
        middle, line_ends = places[0], places[0].beat == self.beats - 1
        with m.If(step):
            m.d.sync += [new.eq(old) for old, new in pairwise(places)]
            m.d.sync += middle.beat.eq(Mux(line_ends, 0, middle.beat + 1))
            with m.If(line_ends):
                m.d.sync += middle.row.eq(middle.row + 1)
                with m.If(middle.row == self.height - 1):
                    m.d.sync += middle.valid.eq(0)
            with m.If(begins):
                m.d.sync += left.eq(self.half * self.beats)
            with m.Elif(left != 0):
                m.d.sync += left.eq(left - 1)
            with m.If(left == 1):
                m.d.sync += [middle.valid.eq(1), middle.row.eq(0), middle.beat.eq(0)]
        return places

    def _rows(self, m: Module, step) -> list[list]:
        """The differences of `window_px` + 1 beats at the same place of successive rows, the newest first."""
        difference = data.ArrayLayout(signed(WIDTH), self.lanes * self.channels)
        m.submodules.rows = memory = Memory(
            shape=data.ArrayLayout(difference, self.window_px),
            depth=self.beats,
            init=[],
            attrs={"ram_style": "distributed" if self.beats <= DISTRIBUTED_BEATS else "block"},
        )
        write, read = memory.write_port(), memory.read_port()
        address = Signal(range(self.beats))
        following = Signal(range(self.beats))
        rows = [Signal(difference, reset_less=True, name=f"row_{k}") for k in range(self.window_px + 1)]
        entering = Cat(vector[c] for vector in self.i.payload for c in range(self.channels))
        m.d.comb += [
            following.eq(Mux(address == self.beats - 1, 0, address + 1)),
            read.addr.eq(following),
            read.en.eq(step),
            write.addr.eq(address),
            write.en.eq(step),
            write.data.eq(Cat(entering, read.data.as_value())),
        ]
        with m.If(step):
            m.d.sync += [address.eq(following), rows[0].eq(entering)]
            m.d.sync += [row.eq(read.data[k]) for k, row in enumerate(rows[1:])]
        return [list(row) for row in rows]

    def _row_sums(self, m: Module, step, rows: list[list], row) -> list:
        """The weighted sums over the rows, of each lane and channel; `row`: of the one in the middle."""
        older = [Signal(name=f"has_row_before_{k}") for k in range(1, self.half + 1)]
        newer = [Signal(name=f"has_row_after_{k}") for k in range(1, self.half + 1)]
        for k in range(self.half):
            m.d.comb += [older[k].eq(row > k), newer[k].eq(row < self.height - 1 - k)]
        return [
            self._sum(
                m,
                step,
                self._chosen([values[n] for values in rows], newer, older),
                255,
                f"rows_{n}",
            )
            for n in range(self.lanes * self.channels)
        ]

    def _column_sums(self, m: Module, step, beats: list[list], beat) -> list:
        """The weighted sums over the columns, of each lane and channel; `beat` is that of the middle."""
        within = {
            b: Signal(name=f"has_beat_{'after' if b > 0 else 'before'}_{abs(b)}")
            for b in range(-self.reach, self.reach + 1)
            if b
        }
        for b, inside in within.items():
            m.d.comb += inside.eq(beat < self.beats - b if b > 0 else beat >= -b)
        within[0] = True
        found = []
        for lane in range(self.lanes):
            at = [divmod(lane + k, self.lanes) for k in range(self.half, -self.half - 1, -1)]
            inside = [within[b] for b, _ in at]
            after, before = inside[: self.half][::-1], inside[self.half + 1 :]
            for c in range(self.channels):
                values = [beats[self.reach - b][other * self.channels + c] for b, other in at]
                chosen = self._chosen(values, after, before)
                found.append(self._sum(m, step, chosen, 255 * 2 * self.window_px, f"columns_{lane}_{c}"))
        return found

    def _chosen(self, values: list, newer: list, older: list) -> list:
        """`window_px` + 1 values, the newest first, where those that lie beyond the image are the outermost
        ones inside.

        newer, older : whether the first, second, … value from the middle is inside, on either side
        """
        chosen = list(values)
        for sign, insides in ((-1, newer), (1, older)):
            for k, inside in enumerate(insides, 1):
                place = self.half + sign * k
                if inside is not True:
                    chosen[place] = Mux(inside, values[place], chosen[place - sign])
        return chosen

    def _sum(self, m: Module, step, values: list, limit: int, name: str):
        """The weighted sum of values of at most `limit`, which pass a register first."""
        weights = smoothing.weights(self.window_px)
        terms = []
        for k, (value, weight) in enumerate(zip(values, weights, strict=True)):
            term = Signal.like(value, reset_less=True, name=f"{name}_{k}")
            with m.If(step):
                m.d.sync += term.eq(value)
            terms.append(term << 1 if weight == 2 else term)
        return adder_tree(m, step, terms, limit * weights[None], name)

    def _codes(self, m: Module, step, place: data.View) -> tuple:
        """The coordinate codes of the beat at `place`, a step later: of its columns, and of its row."""
        found = []
        for name, codes, address in (
            ("u", self.coordinate_u.reshape(self.beats, self.lanes), place.beat),
            ("v", self.coordinate_v, place.row),
        ):
            shape = data.ArrayLayout(signed(WIDTH), self.lanes) if name == "u" else signed(WIDTH)
            m.submodules[name] = memory = Memory(shape=shape, depth=len(codes), init=codes.tolist())
            read = memory.read_port()
            m.d.comb += [read.addr.eq(address), read.en.eq(step)]
            found.append(read.data)
        return tuple(found)
