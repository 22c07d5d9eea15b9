"""The frame store between two recurrences: rows go in first to last and come out last to first."""

from typing import NamedTuple

from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out


class Place(NamedTuple):
    """Where a walk through the page stands, and whether the frame ends there."""

    address: Signal
    row: Signal
    beat: Signal
    last: Signal


class FrameReversal(wiring.Component):
    """Reverse the order of the rows of frames of `size` × `size` values, `lanes` values a clock.

    One page is enough: rows leave in the order in which the next frame's rows may take their places. So
    frames lie in it upwards and downwards in turn, and the writer follows the reader of the frame before.
    The last row is read while it is still being written.

    Members
    -------
    i : stream of `lanes` values, signed(width): `size` rows of `beats` = ceil(size/lanes) beats
    o : stream of the same, the frame's rows last to first, the beats of a row in their order

    Both sides move a beat a clock: a frame every `size` · `beats` clocks. `latency` = 3 clocks pass from the
    first beat of a frame's last row accepted to its first beat out if nothing stalls: the writer's place,
    the memory's read and the output register. `i.ready` comes from registers.
    """

    latency = 3

    def __init__(self, size: int, width: int, *, lanes: int):
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if size <= lanes:
            raise ValueError(f"size {size}: expected more than lanes = {lanes}")
        self.size, self.width, self.lanes = size, width, lanes
        self.beats = -(-size // lanes)
        words = stream.Signature(data.ArrayLayout(signed(width), lanes))
        super().__init__({"i": In(words), "o": Out(words)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.page = page = memory.Memory(
            shape=self.i.payload.shape(),
            depth=self.size * self.beats,
            init=[],
            attrs={"ram_style": "block"},
        )
        write, read = page.write_port(), page.read_port()
        accept, issue, advance = Signal(), Signal(), Signal()
        written = self._walk(m, accept, "write", upwards=True)
        taken = self._walk(m, issue, "read", upwards=False)  # the way of the frame that comes after

        # From its last beat written to its last beat read a frame owns the page, less what was read of it.
        whole = Signal()
        with m.If(accept & written.last):
            m.d.sync += whole.eq(1)
        with m.Elif(issue & taken.last):
            m.d.sync += whole.eq(0)
        m.d.comb += [
            self.i.ready.eq(~whole | (written.address != taken.address)),
            accept.eq(self.i.valid & self.i.ready),
            write.addr.eq(written.address),
            write.data.eq(self.i.payload),
            write.en.eq(accept),
        ]

        valid = Signal(2)
        there = whole | ((written.row == self.size - 1) & (taken.beat < written.beat))
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            issue.eq(advance & there),
            read.addr.eq(taken.address),
            read.en.eq(advance),
            self.o.valid.eq(valid[1]),
        ]
        with m.If(advance):
            m.d.sync += [valid.eq(Cat(issue, valid)), self.o.payload.eq(read.data)]
        return m

    def _walk(self, m, step, name: str, *, upwards: bool) -> Place:
        """Counters through the page, frame by frame up and down in turn, one beat with each `step`."""
        start = 0 if upwards else (self.size - 1) * self.beats
        address = Signal(range(self.size * self.beats), init=start, name=f"{name}_address")
        row, beat = (
            Signal(range(self.size), name=f"{name}_row"),
            Signal(range(self.beats), name=f"{name}_beat"),
        )
        up, last = Signal(init=upwards, name=f"{name}_up"), Signal(name=f"{name}_last")
        m.d.comb += last.eq((row == self.size - 1) & (beat == self.beats - 1))
        with m.If(step):
            m.d.sync += [address.eq(address + 1), beat.eq(beat + 1)]
            with m.If(beat == self.beats - 1):
                m.d.sync += [beat.eq(0), row.eq(row + 1)]
                m.d.sync += address.eq(Mux(up, address + 1, address - (2 * self.beats - 1)))
            with m.If(last):
                # The next frame begins in the row that this one ends in.
                m.d.sync += [row.eq(0), address.eq(address - (self.beats - 1)), up.eq(~up)]
        return Place(address, row, beat, last)
