"""Transposition with two ping-pong frame buffers, between the row and column passes of a 2-D transform."""

from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, memory, stream, wiring
from amaranth.lib.wiring import In, Out


class Transposer(wiring.Component):
    """Transpose frames of `size` × `size` values, `lanes` values per clock in and out.

    Two pages: one frame is written while the previous one is read, and a page is written again as soon as its
    last value has been read. Element (r, c) is in bank (r + c) mod lanes, at address r · beats + c // lanes
    of its page, so that `lanes` neighbours in a row, and in a column, are in different banks.

    Members
    -------
    i : stream of `lanes` values, signed(width): `size` rows of `beats` = ceil(size/lanes) beats
    o : stream of `lanes` values, signed(width): `size` columns of `beats` beats

    The lanes beyond `size` in the last beat of a row or column are undefined. Initiation interval: `size` ·
    `beats` clocks per frame. `latency` = 3 clocks, without back-pressure, from a frame's last input beat to
    its first output beat: page flag, memory read, output register. `i.ready` comes from a register.
    """

    latency = 3

    def __init__(self, size: int, width: int, *, lanes: int):
        if lanes not in (1, 2, 4):
            raise ValueError(f"lanes {lanes}: expected 1, 2 or 4")
        if size <= lanes:
            raise ValueError(f"size {size}: expected more than lanes = {lanes}")
        self.size, self.width, self.lanes = size, width, lanes
        self.beats = -(-size // lanes)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(signed(width), lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(width), lanes))),
            }
        )

    @property
    def page_words(self) -> int:
        """Words of a page in one bank, with the padding of `size` to a whole number of beats."""
        return self.beats * self.lanes * self.beats

    def elaborate(self, platform):
        m = Module()
        words, last_beat, last_line = self.page_words, self.beats - 1, self.size - 1
        writes, reads = [], []
        for bank in range(self.lanes):
            m.submodules[f"bank_{bank}"] = storage = memory.Memory(
                shape=signed(self.width), depth=2 * words, init=[], attrs={"ram_style": "block"}
            )
            writes.append(storage.write_port())
            reads.append(storage.read_port())

        # A page is full from the write of its last beat to the read of its last beat.
        full = Signal(2)
        filled, emptied = Signal(2), Signal(2)
        m.d.sync += full.eq((full | filled) & ~emptied)

        # Write rows.
        write_page = Signal()
        write_address = Signal(range(2 * words))
        row = Signal(range(self.size))
        row_beat = Signal(range(self.beats))
        accept = Signal()
        m.d.comb += [
            self.i.ready.eq(~Mux(write_page, full[1], full[0])),
            accept.eq(self.i.valid & self.i.ready),
        ]
        with m.If(accept):
            m.d.sync += [write_address.eq(write_address + 1), row_beat.eq(row_beat + 1)]
            with m.If(row_beat == last_beat):
                m.d.sync += [row_beat.eq(0), row.eq(row + 1)]
                with m.If(row == last_line):
                    m.d.comb += filled.eq(1 << write_page)
                    m.d.sync += [row.eq(0), write_page.eq(~write_page)]
                    m.d.sync += write_address.eq(Mux(write_page, 0, words))
        for skew in range(self.lanes):
            with m.If((row & (self.lanes - 1)) == skew):
                for lane, value in enumerate(self.i.payload):
                    m.d.comb += writes[(lane + skew) % self.lanes].data.eq(value)
        for write in writes:
            m.d.comb += [write.addr.eq(write_address), write.en.eq(accept)]

        # Read columns while the output has room; `base` is the address of the first row of a beat.
        read_page = Signal()
        base = Signal(range(2 * words))
        column = Signal(range(self.size))
        column_beat = Signal(range(self.beats))
        advance, issue = Signal(), Signal()
        valid = Signal(2)
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            issue.eq(advance & Mux(read_page, full[1], full[0])),
            self.o.valid.eq(valid[1]),
        ]
        with m.If(issue):
            m.d.sync += [base.eq(base + self.lanes * self.beats), column_beat.eq(column_beat + 1)]
            with m.If(column_beat == last_beat):
                following = column + 1
                m.d.sync += [column_beat.eq(0), column.eq(following)]
                m.d.sync += base.eq(Mux(read_page, words, 0) + (following >> (self.lanes - 1).bit_length()))
                with m.If(column == last_line):
                    m.d.comb += emptied.eq(1 << read_page)
                    m.d.sync += [column.eq(0), read_page.eq(~read_page)]
                    m.d.sync += base.eq(Mux(read_page, 0, words))
        column_read = Signal.like(column, reset_less=True)
        for skew in range(self.lanes):
            with m.If((column & (self.lanes - 1)) == skew):
                for lane in range(self.lanes):
                    m.d.comb += reads[(lane + skew) % self.lanes].addr.eq(base + lane * self.beats)
            with m.If(advance & ((column_read & (self.lanes - 1)) == skew)):
                for lane, value in enumerate(self.o.payload):
                    m.d.sync += value.eq(reads[(lane + skew) % self.lanes].data)
        for read in reads:
            m.d.comb += read.en.eq(advance)
        with m.If(advance):
            m.d.sync += [valid.eq(Cat(issue, valid)), column_read.eq(column)]
        return m
