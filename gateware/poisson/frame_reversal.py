"""Frame buffer between the two recurrences that reverses the order of a frame's rows."""

from typing import NamedTuple

from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_fold, pace


class Place(NamedTuple):
    """Position of the writer or reader in the memory; `last`: it is the last beat of a frame."""

    address: Signal
    row: Signal
    beat: Signal
    last: Signal


class FrameReversal(wiring.Component):
    """Reverse the order of the rows of frames of `size` × `size` values, `lanes` values per clock.

    A memory for one frame is enough: the rows are read last to first, and the next frame's rows are written
    in that order into the places that become free. So frames lie in the memory upwards and downwards in turn,
    and the writer follows the reader of the previous frame. The last row is read while it is being written.

    Members
    -------
    i : stream of `lanes` values, signed(width): `size` rows of `beats` = ceil(size/lanes) beats
    o : the same stream with the rows of each frame last to first; beats within a row keep their order, and
        come at most every `fold` clocks

    Initiation interval: fold · `size` · `beats` clocks a frame. `latency` = 3 clocks, without back-pressure,
    from the first beat of a frame's last row to the frame's first output beat: write address, memory read,
    output register. `i.ready` comes from registers.
    """

    latency = 3

    def __init__(self, size: int, width: int, *, lanes: int, fold: int = 1):
        check_fold(fold, lanes)
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if size <= lanes:
            raise ValueError(f"size {size}: expected more than lanes = {lanes}")
        self.size, self.width, self.lanes, self.fold = size, width, lanes, fold
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
        # Read in the direction in which the next frame is written.
        taken = self._walk(m, issue, "read", upwards=False)

        # `whole`: a frame is completely written and not completely read; writing must not overtake reading.
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
        if self.fold > 1:
            there &= pace(m, issue, self.fold)
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
        """Address counters that step through frames, upwards and downwards in turn, one beat per `step`."""
        start = 0 if upwards else (self.size - 1) * self.beats
        address = Signal(range(self.size * self.beats), init=start, name=f"{name}_address")
        row = Signal(range(self.size), name=f"{name}_row")
        beat = Signal(range(self.beats), name=f"{name}_beat")
        up, last = Signal(init=upwards, name=f"{name}_up"), Signal(name=f"{name}_last")
        m.d.comb += last.eq((row == self.size - 1) & (beat == self.beats - 1))
        with m.If(step):
            m.d.sync += [address.eq(address + 1), beat.eq(beat + 1)]
            with m.If(beat == self.beats - 1):
                m.d.sync += [beat.eq(0), row.eq(row + 1)]
                m.d.sync += address.eq(Mux(up, address + 1, address - (2 * self.beats - 1)))
            with m.If(last):
                # The next frame begins in the row in which this one ends.
                m.d.sync += [row.eq(0), address.eq(address - (self.beats - 1)), up.eq(~up)]
        return Place(address, row, beat, last)
