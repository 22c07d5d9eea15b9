"""AXI4-Stream port of an image output: markers, and packets that stay whole when the datapath is reset."""

from amaranth import Cat, Const, Module, Mux, Signal, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

ROW_BITS = 8
"""Bits of the row number in `tuser`."""
TAGGED_USER = 3 + ROW_BITS
"""Bits of `tuser` of a tagged output."""


def raster_members(octets: int, *, tagged: bool) -> dict[str, wiring.Member]:
    """The members of an image output's AXI4-Stream with `octets` bytes per beat, seen from the master."""
    members = {
        "tdata": Out(unsigned(8 * octets)),
        "tvalid": Out(1),
        "tready": In(1),
        "tlast": Out(1),
        "tuser": Out(TAGGED_USER if tagged else 1),
    }
    return members | ({"tkeep": Out(octets)} if tagged else {})


def check_image(rows: int, beats: int, octets: int, void_octets: int) -> None:
    """Raise ValueError for an image that no port can send: see `RasterPort`."""
    for name, value in (("rows", rows), ("beats", beats), ("octets", octets)):
        if value < 1:
            raise ValueError(f"{name} {value}: expected at least 1")
    if not 0 <= void_octets < octets:
        raise ValueError(f"void_octets {void_octets}: expected 0 to {octets - 1}")


class RasterPort(wiring.Component):
    """Send frames of `rows` rows of `beats` beats each as AXI4-Stream packets of one row each.

    A master must not withdraw `tvalid`, and a DMA that has begun a frame waits for its end; so when the
    datapath behind this component is reset, the component itself completes what has begun.

    Members
    -------
    i : stream of a beat's bytes, `tdata`
    bad, suspect : flags of the frame of the beat in `i`. Only if `tagged`.
    cut : high in the clock at whose end the source of `i` is reset. A beat that is offered and not taken
        stays offered unchanged; the rest of the frame is sent as zeros, marked as bad if `tagged`. Then `i`
        goes on with the first beat of a frame.
    port : AXI4-Stream master. `tlast`: end of row; `tuser`: start of frame; if `tagged` also, from bit 1 on,
        bad, row (ROW_BITS) and suspect, and `tkeep`: the bytes that hold a value.
    done : high in the clock in which the last beat of a whole frame is taken

    `latency` = 0: while nothing is being completed, `i` and `port` are the same handshake.
    """

    latency = 0

    def __init__(
        self,
        rows: int,
        beats: int,
        octets: int,
        *,
        tagged: bool,
        void_octets: int = 0,
        rows_reversed: bool = False,
    ):
        check_image(rows, beats, octets, void_octets)
        if tagged and rows > 1 << ROW_BITS:
            raise ValueError(f"rows {rows}: expected at most {1 << ROW_BITS}")
        self.rows, self.beats, self.octets, self.tagged = rows, beats, octets, tagged
        self.void_octets, self.rows_reversed = void_octets, rows_reversed
        flags = {"bad": In(1), "suspect": In(1)} if tagged else {}
        super().__init__(
            {
                "i": In(stream.Signature(unsigned(8 * octets))),
                **flags,
                "cut": In(1),
                "port": Out(wiring.Signature(raster_members(octets, tagged=tagged))),
                "done": Out(1),
            }
        )

    def elaborate(self, platform):
        m = Module()
        port = self.port
        x = Signal(range(self.beats))
        y = Signal(range(self.rows))
        last = Signal()
        ends = Signal()
        taken = Signal()
        m.d.comb += [
            last.eq(x == self.beats - 1),
            ends.eq(last & (y == self.rows - 1)),
            taken.eq(port.tvalid & port.tready),
        ]
        with m.If(taken):
            m.d.sync += x.eq(Mux(last, 0, x + 1))
            with m.If(last):
                m.d.sync += y.eq(Mux(ends, 0, y + 1))

        # What is sent: `i`, or what a reset has left open, of which the first beat may have been offered.
        flags = Cat(self.bad, self.suspect) if self.tagged else Const(0, 2)
        closing = Signal()
        offered = Signal()
        offer = Signal.like(self.i.payload, reset_less=True)
        offer_flags = Signal(2, reset_less=True)
        sent_flags = Signal(2)
        m.d.comb += [
            port.tvalid.eq(self.i.valid | closing),
            self.i.ready.eq(port.tready & ~closing),
            port.tdata.eq(self.i.payload),
            sent_flags.eq(flags),
        ]
        with m.If(closing):
            m.d.comb += [
                port.tdata.eq(Mux(offered, offer, 0)),
                sent_flags.eq(Mux(offered, offer_flags, 0b01)),
            ]
        with m.If(closing & taken):
            m.d.sync += [offered.eq(0), closing.eq(~ends)]
        with m.Elif(self.cut & ~closing):
            waits = self.i.valid & ~port.tready
            inside = Mux(taken, ~ends, (x != 0) | (y != 0))
            m.d.sync += [
                closing.eq(waits | inside),
                offered.eq(waits),
                offer.eq(self.i.payload),
                offer_flags.eq(flags),
            ]

        first = (x == 0) & (y == 0)
        m.d.comb += [port.tlast.eq(last), self.done.eq(self.i.valid & self.i.ready & ends)]
        if not self.tagged:
            m.d.comb += port.tuser.eq(first)
            return m
        row = Signal(ROW_BITS)
        full = (1 << self.octets) - 1
        m.d.comb += [
            row.eq(self.rows - 1 - y if self.rows_reversed else y),
            port.tuser.eq(Cat(first, sent_flags[0], row, sent_flags[1])),
            port.tkeep.eq(Mux(last, full >> self.void_octets, full)),
        ]
        return m
