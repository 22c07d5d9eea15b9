# amaranth: UnusedElaboratable=no
"""Following marker dots from window to window, one dot after another, while the frame still comes in."""

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.dots.window_stream import window_layout
from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.integer.dot_windows import CELL


def dot_layout(follower: DotFollower) -> data.StructLayout:
    """A dot in a frame: its shift in px · 2**FRACTION, and whether it was seen."""
    shift = signed(follower.width)
    return data.StructLayout({"u": shift, "v": shift, "seen": 1})


class DotFollowerStream(wiring.Component):
    """Follow the dots of each frame, bit-exact to `follower(windows)`.

    A memory keeps the last `kept_rows` rows of windows. A dot is followed as soon as all rows are complete
    that it may read, and no row is overwritten before: if need be `i` waits, which costs no values.

    Members
    -------
    i : stream of `per_beat` windows, see `DotWindowStream.o`
    o : stream of one dot per beat, see `dot_layout`; M of them a frame, in the order of `follower.rest`

    `clocks_per_dot` = 10 + q/2 without back-pressure, where q is the number of bits of a quotient, which the
    divisions find by twos. `latency` counts from a frame's last beat of windows to its last dot. `row_clocks`
    is how many clocks a row of windows takes at full rate. Raises ValueError where dots are so many, or so
    close, that `i` would have to wait at that rate.
    """

    multipliers = 0

    def __init__(self, follower: DotFollower, *, per_beat: int, row_clocks: int):
        self.follower, self.per_beat, self.row_clocks = follower, per_beat, row_clocks
        self.rows, columns = follower.windows.shape
        self.row_beats = columns // per_beat
        self.count = len(follower.rest)
        first, last = follower.rows
        self.kept_rows = 1 << int((last - first).max() + 3 - 1).bit_length()
        self._check_rate()
        beat = data.ArrayLayout(window_layout(follower.windows), per_beat)
        super().__init__({"i": In(stream.Signature(beat)), "o": Out(stream.Signature(dot_layout(follower)))})

    @property
    def quotient_bits(self) -> int:
        """Even, and enough for the largest distance from a window's centre."""
        largest = (CELL * (2 * self.follower.windows.half + 1) - 1) << FRACTION
        return largest.bit_length() + largest.bit_length() % 2

    @property
    def clocks_per_dot(self) -> int:
        return 10 + self.quotient_bits // 2

    @property
    def latency(self) -> int:
        return int(self._found_at()[-1]) - self.rows * self.row_clocks

    def _found_at(self) -> np.ndarray:
        """When each dot is offered, in clocks from the start of a frame's first row of windows."""
        clock, found = 0, []
        for row in self.follower.rows[1]:
            # A row counts as complete in the second clock after its last beat: one step's first two clocks.
            clock = max(clock, (int(row) + 1) * self.row_clocks) + self.clocks_per_dot
            found.append(clock)
        return np.array(found)

    def _check_rate(self) -> None:
        first, last = self.follower.rows
        found = self._found_at()
        room = (first + self.kept_rows) * self.row_clocks - found
        frame = (self.rows + 2 * self.follower.windows.half) * self.row_clocks
        room[-1] = min(room[-1], frame + (last[0] + 1) * self.row_clocks - found[-1])
        late = np.flatnonzero(room < 0)
        if len(late):
            u, v = self.follower.rest_px[late[0]]
            raise ValueError(
                f"dot at {u}, {v} px: found {-room[late[0]]} clocks too late, as too many dots share its"
                f" rows; each takes {self.clocks_per_dot} clocks"
            )

    def records(self) -> tuple[data.StructLayout, list[dict]]:
        """What is known of each dot, and its layout."""
        follower = self.follower
        position = unsigned(int(follower.rest.max()).bit_length())
        index, row = (
            unsigned(self.count.bit_length()),
            unsigned(max(self.rows, self.follower.windows.shape[1]).bit_length()),
        )
        mass = unsigned(max(1, int(follower.high.max()).bit_length()))
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
        columns += [*follower.rows, *follower.guides.T, follower.low, follower.high]
        fields = list(layout.members)
        return layout, [
            {name: int(value) for name, value in zip(fields, values, strict=True)}
            for values in zip(*columns, strict=True)
        ]

    def elaborate(self, platform):
        m = Module()
        follower, half = self.follower, self.follower.windows.half

        # Rows of windows come in; `ahead` counts the complete ones from the frame's first that is followed.
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

        # The dot's record is read while the one before is divided.
        record_layout, records = self.records()
        m.submodules.records = table = memory.Memory(
            shape=record_layout, depth=self.count, init=records, attrs={"ram_style": "distributed"}
        )
        fetch = table.read_port()
        dot = Signal(range(self.count))
        base = Signal(range(self.kept_rows))
        record = fetch.data
        m.d.comb += [fetch.addr.eq(dot), self.i.ready.eq(ahead - record.first_row < self.kept_rows)]

        # Shifts in whole pixels of the dots so far; no guide is a dot that stays.
        travel_bits = signed(follower.width - FRACTION + 1)
        travel = data.StructLayout({"u": travel_bits, "v": travel_bits})
        m.submodules.travels = travels = memory.Memory(shape=travel, depth=self.count + 1, init=[])
        remember = travels.write_port()
        guides = [travels.read_port(domain="comb") for _ in range(2)]
        m.d.comb += [port.addr.eq(record[f"guide_{k}"]) for k, port in enumerate(guides)]

        place = {axis: Signal(len(record.low_u), name=f"window_{axis}") for axis in "uv"}
        word = Signal(layout, reset_less=True)
        seen = Signal()
        m.d.comb += [
            read.addr.eq(Cat((place["u"] // self.per_beat)[: len(column)], (base + place["v"])[: len(slot)])),
            read.en.eq(1),
        ]
        chosen = read.data[place["u"][0]] if self.per_beat > 1 else read.data[0]
        axes = {axis: _Axis(self, axis) for axis in "uv"}
        steps = Signal(range(self.quotient_bits // 2))
        m.d.comb += seen.eq((word.mass >= record.least) & (word.mass <= record.most))
        with m.FSM(init="FETCH"):
            with m.State("EXPECT"):
                for axis, a in axes.items():
                    m.d.sync += a.expected.eq((guides[0].data[axis] + guides[1].data[axis] + 1) >> 1)
                with m.If(ahead > record.last_row):
                    m.next = "FIRST"
            with m.State("FIRST"):
                for axis, a in axes.items():
                    near = ((a.rest_px(record) + a.expected) // CELL) - half
                    m.d.sync += place[axis].eq(_clipped(near, record[f"low_{axis}"], record[f"high_{axis}"]))
                m.next = "READ FIRST"
            with m.State("READ FIRST"):
                m.next = "HOLD FIRST"
            with m.State("HOLD FIRST"):
                m.d.sync += word.eq(chosen)
                m.next = "SECOND"
            with m.State("SECOND"):
                for axis, a in axes.items():
                    last = follower.windows.shape["vu".index(axis)] - 1
                    m.d.sync += place[axis].eq(_clipped(place[axis] + a.step(word), 0, last))
                m.next = "READ SECOND"
            with m.State("READ SECOND"):
                m.next = "HOLD SECOND"
            with m.State("HOLD SECOND"):
                m.d.sync += [word.eq(chosen), steps.eq(0)]
                for a in axes.values():
                    m.d.sync += a.start(chosen)
                m.next = "DIVIDE"
            with m.State("DIVIDE"):
                for a in axes.values():
                    m.d.sync += a.divide(word.mass)
                m.d.sync += steps.eq(steps + 1)
                with m.If(steps == self.quotient_bits // 2 - 1):
                    m.next = "MOVE"
            with m.State("MOVE"):
                for axis, a in axes.items():
                    m.d.sync += a.moved.eq(a.centre(place[axis]) + a.offset(word) - record[f"rest_{axis}"])
                m.next = "GIVE"
            with m.State("GIVE"), m.If(~self.o.valid | self.o.ready):
                m.d.comb += [remember.en.eq(1), frame_done.eq(dot == self.count - 1)]
                m.d.sync += [
                    self.o.valid.eq(1),
                    self.o.payload.seen.eq(seen),
                    dot.eq(Mux(frame_done, 0, dot + 1)),
                ]
                m.d.sync += [self.o.payload[axis].eq(Mux(seen, a.moved, 0)) for axis, a in axes.items()]
                with m.If(frame_done):
                    m.d.sync += base.eq(base + self.rows)
                m.next = "FETCH"
            with m.State("FETCH"):
                m.next = "EXPECT"
        with m.If(self.o.ready & ~remember.en):
            m.d.sync += self.o.valid.eq(0)
        m.d.comb += remember.addr.eq(dot)
        for axis, a in axes.items():
            m.d.comb += remember.data[axis].eq(
                Mux(seen, (a.moved + (1 << (FRACTION - 1))) >> FRACTION, a.expected)
            )
        return m


def _clipped(value, low, high):
    return Mux(value < low, low, Mux(value > high, high, value))


class _Axis:
    """The registers of one axis, u or v, and what is computed with them."""

    def __init__(self, stream: DotFollowerStream, axis: str):
        follower = stream.follower
        self.follower, self.axis, self.bits = follower, axis, stream.quotient_bits
        self.expected = Signal(signed(follower.width - FRACTION + 1), name=f"expected_{axis}")
        self.moved = Signal(signed(follower.width), name=f"moved_{axis}", reset_less=True)
        windows = follower.windows
        self.remainder = Signal(windows.mass_width, name=f"remainder_{axis}", reset_less=True)
        self.numerator = Signal(self.bits, name=f"numerator_{axis}", reset_less=True)
        self.quotient = Signal(self.bits, name=f"quotient_{axis}", reset_less=True)

    def rest_px(self, record):
        """The pixel nearest to the dot at rest."""
        return (record[f"rest_{self.axis}"] + (1 << (FRACTION - 1))) >> FRACTION

    def step(self, word):
        """By how many windows the centre of darkness is away; see `DotFollower.step`."""
        mass, moment = word.mass, word[self.axis]
        edges = [2 * CELL * k + CELL for k in range(self.follower.windows.half)]
        beyond = sum((moment >= mass * edge for edge in edges), Const(0, 1))
        before = sum((moment < -(mass * edge) for edge in edges), Const(0, 1))
        return Mux(mass == 0, 0, beyond - before)

    def start(self, word) -> list:
        """Begin |moment| · 2**FRACTION / mass: what is above the quotient's bits is below the mass."""
        moment = word[self.axis]
        scaled = Cat(Const(0, FRACTION), Mux(moment < 0, -moment, moment)[: len(moment)])
        return [
            self.numerator.eq(scaled[: self.bits]),
            self.remainder.eq(scaled[self.bits :]),
            self.quotient.eq(0),
        ]

    def divide(self, mass) -> list:
        """Two steps of restoring division."""
        remainder, bits = self.remainder, []
        for bit in (self.numerator[-1], self.numerator[-2]):
            brought = Cat(bit, remainder)
            fits = brought >= mass
            remainder = Mux(fits, brought - mass, brought)[: len(self.remainder)]
            bits.append(fits & (mass != 0))
        return [
            self.remainder.eq(remainder),
            self.numerator.eq(self.numerator << 2),
            self.quotient.eq(Cat(bits[1], bits[0], self.quotient)),
        ]

    def offset(self, word):
        """The rounded quotient with the moment's sign."""
        rounded = (self.quotient + 1) >> 1
        return Mux(word[self.axis] < 0, -rounded, rounded)

    def centre(self, place):
        """The window's centre in px · 2**FRACTION; see `DotFollower.centre`."""
        return (2 * CELL * (place + self.follower.windows.half) + CELL - 1) << (FRACTION - 1)
