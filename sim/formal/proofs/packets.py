"""Proofs of the packets' components: marks of lines, whole packets whatever resets their sources, no record
lost."""

from amaranth import Cat, Mux, Signal

from fastac.gateware.packet_format import FrameFormat
from fastac.gateware.packets.packet_input import PacketInput
from fastac.gateware.packets.packet_port import PacketPort
from fastac.gateware.packets.record_queue import RecordQueue
from fastac.sim.formal.bench import FormalBench
from fastac.sim.formal.in_order import InOrder
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs.streams import fifo_words

LINES, LINE_BEATS, PAUSE = 2, 3, 2
ROWS, BEATS, OCTETS, RECORD_OCTETS, ABORTED = 2, 2, 1, 2, 0xA55A
FRAMES, BITS = 4, 2


def packet_input(component: type) -> FormalBench:
    """Packets of any length; nothing is assumed of the input, not even that a beat stays offered."""
    total = LINES * LINE_BEATS
    bench = FormalBench(component(FrameFormat(LINES, 2 * LINE_BEATS, 3, 2), pause=PAUSE))
    m, dut, axis, o = bench.m, bench.dut, bench.dut.axis, bench.dut.o
    valid, last, ready = bench.free("valid"), bench.free("last"), bench.free("ready")
    enable, data = bench.free("enable"), bench.free("data", 64)
    for port, value in (
        *((axis.tvalid, valid), (axis.tlast, last), (axis.tdata, data)),
        *((axis.tkeep, bench.free("keep", 8)), (o.tready, ready), (dut.enable, enable)),
    ):
        bench.drive(port, value)

    # Place of the next beat in its packet, by the transfers alone; `total` and beyond is surplus.
    taken = bench.wire("taken", valid & axis.tready)
    place = Signal(range(total + 1))
    with m.If(taken):
        m.d.sync += place.eq(Mux(last, 0, Mux(place == total, total, place + 1)))
    short = Signal()  # the last packet was too short, and its frame has not been ended
    with m.If(short & ready):
        m.d.sync += short.eq(0)
    with m.If(taken & last):
        m.d.sync += short.eq(place < total - 1)
    since = Signal(range(PAUSE + 1), init=PAUSE)  # clocks since the last packet's end
    m.d.sync += since.eq(Mux(taken & last, 0, Mux(since == PAUSE, PAUSE, since + 1)))
    pauses = bench.wire("pauses", since < PAUSE)

    x, y = bench.probe("x", range(LINE_BEATS)), bench.probe("y", range(LINES))
    surplus = bench.probe("surplus")
    bench.always("it knows the beat's place", Mux(surplus, total, y * LINE_BEATS + x) == place)
    bench.always("beyond the frame it is at no line's place", ~surplus | ((x == 0) & (y == 0)))
    bench.always("the place is inside the line", x < LINE_BEATS)
    bench.always("it knows of a short packet", bench.probe("made_up") == short)
    bench.always("it waits as long as said", bench.probe("waits", range(PAUSE + 1)) == PAUSE - since)

    bench.always("`accepted` tells of each beat", dut.accepted == taken)
    bench.always("a beat is taken where it goes on", taken == (valid & ready & ~short & ~pauses))
    bench.always("each beat goes on in the same clock", o.tvalid == (short | (valid & ~pauses)))
    line_ends = (place % LINE_BEATS == LINE_BEATS - 1) & (place < total)
    offered = o.tvalid & ~short
    bench.always("a packet's first beat starts a frame", ~offered | (o.tuser == (place == 0)))
    bench.always(
        "lines end where they should, and with the packet", ~offered | (o.tlast == (last | line_ends))
    )
    pixels = Cat(data[:24], data[32:56])
    bench.always("pixels without their padding", ~offered | (o.tdata == pixels))
    bench.always("it does not change what is enabled", ~offered | (dut.o_enable == enable))
    bench.always("a short frame is ended by a start that is not enabled", ~short | (o.tuser & ~dut.o_enable))
    waits = Signal(range(PAUSE + 4))
    m.d.sync += waits.eq(Mux(ready & ~axis.tready, waits + 1, 0))
    bench.always("no deadlock: ready again after the pause", waits <= PAUSE + 1)
    return bench


def packet_port(component: type) -> FormalBench:
    """Sources of image and records are reset in any clock by `cut`; the port goes on by the rules of AXI."""
    bench = FormalBench(
        component(ROWS, BEATS, OCTETS, record_octets=RECORD_OCTETS, aborted=ABORTED, void_octets=0)
    )
    m, dut, port = bench.m, bench.dut, bench.dut.port
    total, trailer = ROWS * BEATS, RECORD_OCTETS // OCTETS
    cut, ready = bench.free("cut"), bench.free("ready")
    valid, payload = bench.free("valid"), bench.free("payload", 8 * OCTETS)
    known, record = bench.free("known"), bench.free("record", 8 * RECORD_OCTETS)
    for member, value in (
        *((dut.cut, cut), (port.tready, ready), (dut.i.valid, valid), (dut.i.payload, payload)),
        *((dut.record.valid, known), (dut.record.payload, record)),
    ):
        bench.drive(member, value)
    was_cut = bench.past(cut, "was_cut")
    bench.assume(bench.held("i", valid, dut.i.ready, payload)[1] | was_cut)
    bench.assume(bench.held("record", known, dut.record.ready, record)[1] | was_cut)

    out = Cat(port.tdata, port.tlast, port.tkeep)
    bench.always(
        "tvalid holds and the beat is stable until it is taken", bench.held("o", port.tvalid, ready, out)[1]
    )
    taken = bench.wire("taken", port.tvalid & ready)
    place = Signal(range(total + trailer))
    last = bench.wire("last", place == total + trailer - 1)
    with m.If(taken):
        m.d.sync += place.eq(Mux(last, 0, place + 1))
    bench.always("the place is inside the packet", place < total + trailer)
    bench.always("tlast ends each packet, nothing else", ~port.tvalid | (port.tlast == last))
    bench.always("all bytes count", port.tkeep.all())
    behind = bench.wire("behind_image", place >= total)
    x, y = bench.probe("x", range(BEATS)), bench.probe("y", range(ROWS))
    bench.always("it knows whether the trailer is next", bench.probe("behind") == behind)
    bench.always("it knows the image's place", y * BEATS + x == Mux(behind, 0, place))
    beat, held = bench.probe("trailer.beat", range(trailer)), bench.probe("trailer.held")
    bench.always("it knows the trailer's place", beat == Mux(behind, place - total, 0))
    bench.always("a trailer that has begun is there", held | (beat == 0))

    # The record that the trailer is made of, or that none has come; `cut_open`: the packet was cut.
    image_ends = bench.wire("image_ends", taken & (place == total - 1))
    have, cut_open, closing = Signal(), Signal(), Signal()
    caught = Signal(8 * RECORD_OCTETS, reset_less=True)
    takes = bench.wire("takes_record", known & dut.record.ready)
    inside = bench.wire("inside", Mux(taken, ~last, place != 0) | (port.tvalid & ~ready))
    complete = bench.wire("complete", have & (behind | image_ends))
    with m.If(takes):
        m.d.sync += [have.eq(1), caught.eq(record)]
    with m.If(taken & last):
        m.d.sync += [have.eq(0), cut_open.eq(0)]
    with m.If(closing & image_ends):
        m.d.sync += closing.eq(0)
    with m.If(cut & ~cut_open & ~complete):
        m.d.sync += [have.eq(0), cut_open.eq(inside), closing.eq(inside & ~behind & ~image_ends)]
    bench.always("completes the image that a reset left open", bench.probe("closing") == closing)
    bench.always("a packet that was cut has no other record", ~(have & cut_open))
    aborting = bench.probe("aborting")
    bench.always(
        "it has the record, or the one for packets that were cut", (held | aborting) == (have | cut_open)
    )
    bench.always("one of both", ~(held & aborting))
    bench.always("only a packet that was cut gets that one", ~aborting | cut_open)
    bench.always("a packet that was cut is being completed", ~cut_open | closing | behind)
    bench.always("an image is completed only where it was cut", ~closing | (cut_open & ~behind))
    rest = bench.probe("trailer.rest", 8 * RECORD_OCTETS)
    wanted = Mux(cut_open, ABORTED, caught)
    bench.always("the record is kept", ~held | (rest == wanted >> 8 * OCTETS * beat))
    bench.always(
        "the trailer is the frame's record", ~(behind & port.tvalid) | (port.tdata == rest[: 8 * OCTETS])
    )
    bench.always("a record is taken once a packet", ~takes | ~(have | cut_open))
    bench.always("a trailer waits for its record only", ~behind | (port.tvalid == held))

    # The image: beats of `i`, each once, or zeros behind the one that a reset left offered.
    offered = Signal()
    with m.If(closing):
        m.d.sync += offered.eq(offered & ~taken)
    with m.Elif(cut & ~cut_open & ~complete):
        m.d.sync += offered.eq(port.tvalid & ~ready & ~behind)
    bench.always("an offered beat stays", bench.probe("offered") == offered)
    bench.always("no beat of a cut image stays offered behind it", closing | ~offered)
    bench.always("a cut image goes on with zeros", ~(closing & ~offered) | (port.tvalid & (port.tdata == 0)))
    passes = ~behind & ~closing
    bench.always("else beats are those of `i`", ~(passes & port.tvalid) | (port.tdata == payload))
    bench.always("each beat of `i` leaves once", (valid & dut.i.ready) == (passes & taken))
    bench.always("no deadlock: the image's beats are offered", ~passes | (port.tvalid == valid))
    return bench


def record_queue(component: type) -> FormalBench:
    """Frames are let in while there is room; at most one more than were let in has given its record."""
    bench = FormalBench(component(frames=FRAMES, bits=BITS))
    m, dut = bench.m, bench.dut
    wants, gives, record = bench.free("wants"), bench.free("gives"), bench.free("record", BITS)
    enters = bench.wire("enters", wants & dut.room)
    bench.drive(dut.enters, enters)
    bench.drive(dut.record_valid, gives)
    bench.drive(dut.record, record)
    leaves = bench.sink(dut.o, "o")
    level, words = fifo_words(bench, "queue", FRAMES, BITS)
    inside = Signal(range(FRAMES + 1))  # let in, record not taken
    m.d.sync += inside.eq(inside + enters - leaves)
    bench.assume(level + gives <= inside + 1)
    bench.assume(~leaves | (inside != 0))
    bench.always("it counts the frames inside", bench.probe("inside", range(FRAMES)) == inside)
    bench.always("room for one more", dut.room == (inside != FRAMES - 1))
    bench.always("no more frames than have room", inside <= FRAMES - 1)
    bench.always("no record finds the queue full", ~gives | (level != FRAMES))
    track = InOrder(bench, gives, record, leaves, dut.o.payload, capacity=FRAMES)
    bench.always("as many records inside as have come", track.inside == level)
    bench.always("no deadlock: a record is offered", dut.o.valid == (level != 0))
    track.stored(bench, words)
    return bench


PROOFS = (
    Proof(
        "packet_input",
        PacketInput,
        f"{LINES} lines of {LINE_BEATS} beats of two pixels with three channels, a pause of {PAUSE} clocks."
        " The component compares its position with the last of line and frame only",
        packet_input,
        depth=3,
        breaks=(
            ("made_up.eq(~frame_ends & ~surplus)", "made_up.eq(~frame_ends)"),
            ("made_up.eq(~frame_ends & ~surplus)", "made_up.eq(0)"),
            ("(x == 0) & (y == 0) & ~surplus", "(x == 0) & (y == 0)"),
            ("axis.tlast | (line_ends & ~surplus)", "line_ends & ~surplus"),
            ("o.tready & ~made_up & (waits == 0)", "o.tready & (waits == 0)"),
            ("self.enable & ~made_up", "self.enable"),
            ("*(x.eq(0), y.eq(0), surplus.eq(0))", "*(x.eq(0), surplus.eq(0))"),
            ("lane * stride", "lane * 8 * frame.channels"),
        ),
        quick=True,
    ),
    Proof(
        "packet_port",
        PacketPort,
        f"{ROWS} rows of {BEATS} beats of {OCTETS} byte, records of {RECORD_OCTETS} bytes; the port compares"
        " its position with the last only, and moves bytes without looking at them",
        packet_port,
        depth=3,
        breaks=(
            ("closing.eq(waits | inside)", "closing.eq(inside)"),
            ("closing.eq(waits | inside)", "closing.eq(waits)"),
            ("Mux(offered, offer, 0)", "0"),
            ("aborting.eq(waits | inside | behind | (taken & ends))", "aborting.eq(waits | inside)"),
            ("self.cut & ~closing & ~complete", "self.cut & ~closing"),
            ("self.cut & ~closing & ~complete", "self.cut & ~complete"),
            ("trailer.i.ready & ~aborting", "trailer.i.ready"),
            ("m.d.comb += trailer.drop.eq(1)", "m.d.comb += trailer.drop.eq(0)"),
            ("trailer.o.valid & (behind | (taken & ends))", "trailer.o.valid & behind"),
        ),
        quick=True,
    ),
    Proof(
        "record_queue",
        RecordQueue,
        f"{FRAMES} frames and words of {BITS} bits; words are moved without being looked at",
        record_queue,
        depth=3,
        breaks=(
            ("following != self.frames - 1", "following != self.frames"),
            ("self.enters - leaves", "self.enters"),
            ("queue.w_en.eq(self.record_valid)", "queue.w_en.eq(self.record_valid & self.room)"),
            ("self.o.valid.eq(queue.r_rdy)", "self.o.valid.eq(queue.r_rdy & self.room)"),
        ),
        quick=True,
    ),
)
