"""Proof of an image output's AXI4-Stream port: packets stay whole, also when the datapath is reset."""

from amaranth import Cat, Mux, Signal

from fastac.gateware.stream.raster_port import ROW_BITS, RasterPort
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.proof import Proof

ROWS, BEATS, OCTETS = 2, 2, 2


def raster_port(component: type) -> FormalBench:
    """The source of `i` is reset in any clock by `cut`, and the port must go on by the rules of AXI."""
    bench = FormalBench(component(ROWS, BEATS, OCTETS, tagged=True, void_octets=1))
    m, dut, port = bench.m, bench.dut, bench.dut.port
    cut, ready = bench.free("cut"), bench.free("ready")
    valid, payload = bench.free("valid"), bench.free("payload", 8 * OCTETS)
    flags = bench.free("bad"), bench.free("suspect")
    for member, value in (
        *((dut.cut, cut), (port.tready, ready), (dut.i.valid, valid), (dut.i.payload, payload)),
        *((dut.bad, flags[0]), (dut.suspect, flags[1])),
    ):
        bench.drive(member, value)
    # Offered beats are held, flags too, unless the source was reset.
    held = bench.held("i", valid, dut.i.ready, Cat(payload, *flags))[1]
    bench.assume(held | bench.past(cut, "was_cut"))

    out = Cat(port.tdata, port.tlast, port.tuser, port.tkeep)
    bench.always(
        "tvalid holds and the beat is stable until it is taken", bench.held("o", port.tvalid, ready, out)[1]
    )

    # Position in the frame by the transfers alone.
    taken = bench.wire("taken", port.tvalid & ready)
    place = Signal(range(ROWS * BEATS))
    ends = bench.wire("ends", place == ROWS * BEATS - 1)
    with m.If(taken):
        m.d.sync += place.eq(Mux(ends, 0, place + 1))
    row, last = bench.wire("row", place // BEATS), bench.wire("last", place % BEATS == BEATS - 1)
    bench.always("tlast ends each row, nothing else", port.tlast == last)
    bench.always("the first beat of a frame is marked", port.tuser[0] == (place == 0))
    bench.always("beats bear their row", port.tuser[2 : 2 + ROW_BITS] == row)
    bench.always("tkeep leaves out void bytes", port.tkeep == Mux(last, 0b01, 0b11))
    x, y = bench.probe("x", range(BEATS)), bench.probe("y", range(ROWS))
    bench.always("the port's position is that of its beats", y * BEATS + x == place)

    # What a reset left open: the rest of this frame, and nothing else, does not come from `i`.
    open_, offer = Signal(), Signal()  # a frame is being completed; its next beat had been offered
    inside = Mux(taken, ~ends, place != 0)
    with m.If(open_):
        m.d.sync += open_.eq(~(taken & ends))
        with m.If(taken):
            m.d.sync += offer.eq(0)
    with m.Elif(cut):
        m.d.sync += [open_.eq((port.tvalid & ~ready) | inside), offer.eq(port.tvalid & ~ready)]
    bench.always("completes what a reset left open, and only that", bench.probe("closing") == open_)
    bench.always("an offered beat stays", bench.probe("offered") == offer)
    filler = open_ & ~offer
    bench.always("a completed frame is marked as bad", ~filler | (port.tvalid & port.tuser[1]))
    bench.always("and goes on with zeros", ~filler | (port.tdata == 0))
    same = (port.tdata == payload) & (port.tuser[1] == flags[0]) & (port.tuser[-1] == flags[1])
    bench.always("else beats and flags are those of `i`", open_ | ~port.tvalid | same)
    bench.always("nothing is taken from `i` meanwhile", ~(open_ & dut.i.ready))
    bench.always("each beat of `i` leaves once", open_ | ((valid & dut.i.ready) == taken))
    bench.always("`done` tells of whole frames of `i`", dut.done == (taken & ends & ~open_))
    bench.always("no deadlock: offers what there is", port.tvalid == (valid | open_))
    return bench


PROOFS = (
    Proof(
        "raster_port",
        RasterPort,
        f"{ROWS} rows of {BEATS} beats of {OCTETS} bytes; the port compares its position with the last only",
        raster_port,
        depth=2,
        breaks=(
            ("closing.eq(waits | inside)", "closing.eq(inside)"),
            ("closing.eq(waits | inside)", "closing.eq(waits)"),
            ("Mux(offered, offer, 0)", "0"),
            ("self.i.ready.eq(port.tready & ~closing)", "self.i.ready.eq(port.tready)"),
            ("Mux(offered, offer_flags, 0b01)", "0b01"),
            ("m.d.comb += [port.tlast.eq(last)", "m.d.comb += [port.tlast.eq(ends)"),
        ),
        quick=True,
    ),
)
