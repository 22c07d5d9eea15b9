"""Transposition in one frame's memory, for folded solvers between the row and column passes."""

from typing import NamedTuple

from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_folded, pace


class Place(NamedTuple):
    """Position of the writer or reader in the memory; `last`: it is the last value of a frame."""

    address: Signal
    last: Signal


class InPlaceTransposer(wiring.Component):
    """Transpose frames of `size` × `size` values, one value every `fold` clocks, in a memory for one frame.

    Columns are read, and the next frame's rows are written in that order into the places that become free.
    So frames lie in the memory by rows and by columns in turn, and the writer follows the reader of the
    previous frame. `Transposer` has two pages instead, so that no writer waits for a reader.

    Members
    -------
    i : stream of one value, signed(width): `size` rows of `size` values
    o : stream of one value, signed(width): `size` columns, a value at most every `fold` clocks

    Initiation interval: `interval` = fold · `size`² clocks per frame; with a fold of 1 a frame would wait for
    the writer, so there is none. `latency` = 3 clocks, without back-pressure, from a frame's last input value
    to its first output value: frame flag, memory read, output register. `i.ready` comes from registers.
    """

    latency = 3

    def __init__(self, size: int, width: int, *, fold: int):
        check_folded(fold)
        if size < 2:
            raise ValueError(f"size {size}: expected at least 2")
        self.size, self.width, self.fold = size, width, fold
        self.interval = fold * size**2
        words = stream.Signature(data.ArrayLayout(signed(width), 1))
        super().__init__({"i": In(words), "o": Out(words)})

    def elaborate(self, platform):
        m = Module()
        m.submodules.page = page = memory.Memory(
            shape=self.i.payload.shape(), depth=self.size**2, init=[], attrs={"ram_style": "block"}
        )
        write, read = page.write_port(), page.read_port()
        accept, issue, advance = Signal(), Signal(), Signal()
        written = self._walk(m, accept, "write", by_columns=False)
        taken = self._walk(m, issue, "read", by_columns=True)  # as the next frame is written

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
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            issue.eq(advance & whole & pace(m, issue, self.fold)),
            read.addr.eq(taken.address),
            read.en.eq(advance),
            self.o.valid.eq(valid[1]),
        ]
        with m.If(advance):
            m.d.sync += [valid.eq(Cat(issue, valid)), self.o.payload.eq(read.data)]
        return m

    def _walk(self, m, step, name: str, *, by_columns: bool) -> Place:
        """Address counters that step through frames, by rows and by columns in turn, a value per `step`."""
        end = self.size - 1
        address = Signal(range(self.size**2), name=f"{name}_address")
        line = Signal(range(self.size), name=f"{name}_line")
        place = Signal(range(self.size), name=f"{name}_place")
        across, last = Signal(init=by_columns, name=f"{name}_across"), Signal(name=f"{name}_last")
        m.d.comb += last.eq((line == end) & (place == end))
        with m.If(step):
            m.d.sync += [address.eq(address + Mux(across, self.size, 1)), place.eq(place + 1)]
            with m.If(place == end):
                m.d.sync += [place.eq(0), line.eq(line + 1)]
                m.d.sync += address.eq(address - Mux(across, end * self.size - 1, -1))
            with m.If(last):
                m.d.sync += [line.eq(0), address.eq(0), across.eq(~across)]
        return Place(address, last)
