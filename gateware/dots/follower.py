# amaranth: UnusedElaboratable=no
"""Following marker dots from window to window, one dot after another, while the frame still comes in."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.dots.axis import DotAxis, quotient_bits
from fastac.gateware.dots.window_stream import window_layout
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.dot_follower import DotFollower

DISORDER = 2
"""By how many rows of windows loaded dots may be out of the order of their rows. Rows of windows are kept for
so many more than a dot needs by itself; where few dots share them, they do for more disorder."""


def dot_layout(follower: DotFollower) -> data.StructLayout:
    """A dot in a frame: its shift in px · 2**FRACTION, and whether it was seen."""
    shift = signed(follower.width)
    return data.StructLayout({"u": shift, "v": shift, "seen": 1})


class DotFollowerStream(wiring.Component):
    """Follow the dots of each frame, bit-exact to `follower(windows)`.

    A memory keeps the last `kept_rows` rows of windows. A dot is followed as soon as all rows are complete
    that it may read, and no row is overwritten before that it or a later one may read: if need be `i` waits,
    which costs no values.

    Members
    -------
    i : stream of `per_beat` windows, see `DotWindowStream.o`
    o : stream of one dot per beat, see `dot_layout`; M of them a frame, in the order of `follower.rest`
    write : write port of what is known of each dot, see `table`; must not be used while a frame is in flight.
        Only if `follower.loadable`.

    `clocks_per_dot` = 10 + q/2 without back-pressure, where q is the number of bits of a quotient, which the
    divisions find by twos. `latency` counts from a frame's last beat of windows to its last dot. `row_clocks`
    is how many clocks a row of windows takes at full rate. Raises ValueError where dots are so many, so
    close, or so far from the order of their rows, that `i` could have to wait at that rate. Where dots can be
    loaded, words and `kept_rows` are the same wherever dots are.
    """

    multipliers = 0

    def __init__(self, follower: DotFollower, *, per_beat: int, row_clocks: int):
        self.follower, self.per_beat, self.row_clocks = follower, per_beat, row_clocks
        self.rows, columns = follower.windows.shape
        self.row_beats = columns // per_beat
        self.count = len(follower.rest)
        self.kept_rows = self._rows_to_keep()
        self._check_rate()
        beat = data.ArrayLayout(window_layout(follower.windows), per_beat)
        members = {"i": In(stream.Signature(beat)), "o": Out(stream.Signature(dot_layout(follower)))}
        self.table = RecordTable(*self._records())
        if follower.loadable:
            members["write"] = In(self.table.format.signature)
        super().__init__(members)

    @property
    def clocks_per_dot(self) -> int:
        return 10 + quotient_bits(self.follower) // 2

    @property
    def latency(self) -> int:
        return int(self._found_at()[-1]) - self.rows * self.row_clocks

    def _found_at(self) -> np.ndarray:
        """When each dot is offered, in clocks from the start of a frame's first row of windows."""
        clock, found = 0, []
        for row in self.follower.rows[1]:
            # FETCH and EXPECT are done while a dot waits for its row.
            clock = max(clock, (int(row) + 1) * self.row_clocks) + self.clocks_per_dot
            found.append(clock)
        return np.array(found)

    def _rows_to_keep(self) -> int:
        """A power of two, for addresses: rows of a dot and of later ones, and as they come in and go."""
        follower = self.follower
        most = 2 * (follower.reach + follower.windows.half) + DISORDER
        if not follower.loadable:
            most = int((follower.rows[1] - follower.needed_rows).max())
        return 1 << (most + 3 - 1).bit_length()

    def _check_rate(self) -> None:
        (first, last), needed = self.follower.rows, self.follower.needed_rows
        found = self._found_at()
        room = (needed + self.kept_rows) * self.row_clocks - found
        frame = (self.rows + 2 * self.follower.windows.half) * self.row_clocks
        room[-1] = min(room[-1], frame + (last[0] + 1) * self.row_clocks - found[-1])
        # Where there is no room for a row that a later dot needs, there is none for that dot either.
        late = np.flatnonzero((room < 0) & (needed == first))
        if len(late):
            u, v = self.follower.rest_px[late[0]]
            raise ValueError(
                f"dot at {u}, {v} px: found {-room[late[0]]} clocks too late, as too many dots share its rows"
                f" or come before it: {self.kept_rows} rows are kept, a dot takes {self.clocks_per_dot}"
            )

    def _records(self) -> tuple[data.StructLayout, list[dict]]:
        """The layout of what is known of each dot, and that of each dot."""
        follower = self.follower
        position = unsigned(int(follower.possible_rest.max()).bit_length())
        index, row = (unsigned(n.bit_length()) for n in (self.count, max(follower.windows.shape)))
        low, high = follower.low, follower.high
        if follower.loadable:
            # No sum is beyond `most`, so that all limits beyond it are alike.
            most = follower.windows.mass_bound + 1
            low, high = np.minimum(low, most), np.minimum(high, most)
        else:
            most = int(high.max())
        mass = unsigned(max(1, most.bit_length()))
        names = [f"{what}_{axis}" for what in ("low", "high") for axis in "uv"]
        layout = data.StructLayout(
            {
                "rest_u": position,
                "rest_v": position,
                **dict.fromkeys(names, row),
                "first_row": row,
                "last_row": row,
                "guide_0": index,
                "guide_1": index,
                "least": mass,
                "most": mass,
            }
        )
        columns = [*follower.rest.T, *follower.first_windows[0].T, *follower.first_windows[1].T]
        columns += [follower.needed_rows, follower.rows[1], *follower.guides.T, low, high]
        fields = list(layout.members)
        return layout, [
            {name: int(value) for name, value in zip(fields, values, strict=True)}
            for values in zip(*columns, strict=True)
        ]

    def elaborate(self, platform):
        m = Module()
        follower = self.follower

        # Rows of windows come in. `ahead` counts the complete ones from the first row of the frame whose dots
        # are followed; it is negative while the rest of the frame before comes in.
        layout = window_layout(follower.windows)
        column = Signal(range(self.row_beats))
        slot = Signal(range(self.kept_rows))
        stride = 1 << len(column)
        m.submodules.windows = windows = memory.Memory(
            shape=data.ArrayLayout(layout, self.per_beat),
            depth=self.kept_rows * stride,
            init=[],
            attrs={"ram_style": "block"},
        )
        write, read = windows.write_port(), windows.read_port()
        ahead = Signal(signed((2 * self.rows + self.kept_rows).bit_length() + 1))
        row_done = Signal()
        frame_done = Signal()
        m.d.comb += [
            write.addr.eq(Cat(column, slot)),
            write.data.eq(self.i.payload),
            write.en.eq(self.i.valid & self.i.ready),
            row_done.eq(write.en & (column == self.row_beats - 1)),
        ]
        m.d.sync += ahead.eq(ahead + row_done - Mux(frame_done, self.rows, 0))
        with m.If(write.en):
            m.d.sync += column.eq(Mux(row_done, 0, column + 1))
        with m.If(row_done):
            m.d.sync += slot.eq(slot + 1)

        table = self.table.memory(m, "records", self.write if follower.loadable else None)
        fetch = table.read_port()
        dot = Signal(range(self.count))
        base = Signal(range(self.kept_rows))  # slot of the frame's first row
        record = fetch.data
        m.d.comb += [fetch.addr.eq(dot), self.i.ready.eq(ahead - record.first_row < self.kept_rows)]

        # Travels in whole pixels of the dots so far; the last entry, that of no guide, stays 0.
        axes = [DotAxis(follower, axis, len(record.first_row)) for axis in "uv"]
        travel = data.StructLayout({a.axis: a.expected.shape() for a in axes})
        m.submodules.travels = travels = memory.Memory(shape=travel, depth=self.count + 1, init=[])
        remember = travels.write_port()
        guides = [travels.read_port(domain="comb") for _ in range(2)]
        m.d.comb += [port.addr.eq(record[f"guide_{k}"]) for k, port in enumerate(guides)]

        u, v = (a.place for a in axes)
        m.d.comb += [read.addr.eq(Cat((u // self.per_beat)[: len(column)], (base + v)[: len(slot)]))]
        words = [read.data[k].as_value() for k in range(self.per_beat)]
        chosen = data.View(layout, Mux(u[0], words[-1], words[0]) if self.per_beat > 1 else words[0])
        word = Signal(layout, reset_less=True)
        seen = Signal()
        steps = quotient_bits(follower) // 2
        step = Signal(range(steps))
        m.d.comb += [
            seen.eq((word.mass >= record.least) & (word.mass <= record.most)),
            remember.addr.eq(dot),
            *(remember.data[a.axis].eq(a.travel(seen)) for a in axes),
        ]
        first, second = [a.look(m, record) for a in axes], [a.step(m, word) for a in axes]
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.FSM():
            with m.State("FETCH"):
                m.next = "EXPECT"
            with m.State("EXPECT"):
                m.d.sync += [a.expect([port.data for port in guides]) for a in axes]
                with m.If(ahead > record.last_row):
                    m.next = "LOOK"
            with m.State("LOOK"):
                m.d.sync += first
                m.next = "READ FIRST"
            with m.State("READ FIRST"):
                m.next = "HOLD FIRST"
            with m.State("HOLD FIRST"):
                m.d.sync += word.eq(chosen)
                m.next = "STEP"
            with m.State("STEP"):
                m.d.sync += second
                m.next = "READ SECOND"
            with m.State("READ SECOND"):
                m.next = "HOLD SECOND"
            with m.State("HOLD SECOND"):
                m.d.sync += [word.eq(chosen), step.eq(0), *(a.start(chosen) for a in axes)]
                m.next = "DIVIDE"
            with m.State("DIVIDE"):
                m.d.sync += [step.eq(step + 1), *(a.divide(word.mass) for a in axes)]
                with m.If(step == steps - 1):
                    m.next = "MOVE"
            with m.State("MOVE"):
                m.d.sync += [a.move(word, record) for a in axes]
                m.next = "GIVE"
            with m.State("GIVE"), m.If(~self.o.valid | self.o.ready):
                m.d.comb += [remember.en.eq(1), frame_done.eq(dot == self.count - 1)]
                m.d.sync += [
                    *(self.o.valid.eq(1), self.o.payload.seen.eq(seen)),
                    *(self.o.payload[a.axis].eq(Mux(seen, a.moved, 0)) for a in axes),
                    dot.eq(Mux(frame_done, 0, dot + 1)),
                    base.eq(base + Mux(frame_done, self.rows, 0)),
                ]
                m.next = "FETCH"
        return m
