"""AXI4-Stream port of an image output in packets: the image, then the record of its frame."""

from amaranth import Module, Mux, Signal, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.record import (
    FORMAT_LOW,
    PLAIN,
    RECORD_BYTES,
    WORD_BITS,
    RecordFlag,
    RecordForm,
)
from fastac.gateware.packets.packet_input import packet_signature
from fastac.gateware.packets.record_beats import RecordBeats
from fastac.gateware.stream.raster_port import check_image


def aborted_record(form: RecordForm) -> int:
    """The record of a packet that a soft reset cut: flags and format alone, all other words are 0."""
    flags = int(RecordFlag.BAD | RecordFlag.ABORTED) | form.number << FORMAT_LOW
    return flags << WORD_BITS * form.words.index("FLAGS")


ABORTED = aborted_record(PLAIN)


class PacketPort(wiring.Component):
    """Send frames of `rows` rows of `beats` beats as packets of one frame each, with a record as trailer.

    A master must not withdraw `tvalid`, and a DMA that has begun a packet waits for its end; so when the
    datapath behind this component is reset, the component itself completes what has begun.

    Members
    -------
    i : stream of a beat's bytes, `tdata`. The last `void_octets` of a row's last beat are sent as zeros.
    record : stream of records, 8 · record_octets bits, one for each frame of `i` in their order. A packet's
        trailer waits for it; it may come at any time and depends on no beat behind the frame's own.
    cut : high in the clock at whose end the sources of `i` and `record` are reset. A beat that is offered and
        not taken stays offered unchanged. Of a packet that has begun, the rest of the image is sent as zeros,
        and `aborted` as its record; but where the trailer has begun, the packet is complete and ends as it
        would have. Then `i` goes on with the first beat of a frame.
    port : AXI4-Stream master. `tlast`: the packet's last beat; `tkeep`: all ones.

    `latency` = 0: in an image that is not being completed, `i` and `port` are the same handshake. The trailer
    follows the image without a gap if the record was offered a clock before the image's last beat was taken,
    or earlier; else its first beat comes `RecordBeats.latency` clocks after the record.
    """

    latency = 0

    def __init__(
        self,
        rows: int,
        beats: int,
        octets: int,
        *,
        void_octets: int = 0,
        record_octets: int = RECORD_BYTES,
        aborted: int = ABORTED,
    ):
        check_image(rows, beats, octets, void_octets)
        self.rows, self.beats, self.octets, self.void_octets = rows, beats, octets, void_octets
        self.record_octets, self.aborted = record_octets, aborted
        super().__init__(
            {
                "i": In(stream.Signature(unsigned(8 * octets))),
                "record": In(stream.Signature(unsigned(8 * record_octets))),
                "cut": In(1),
                "port": Out(packet_signature(octets)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        port = self.port
        m.submodules.trailer = trailer = RecordBeats(self.octets, record_octets=self.record_octets)

        x = Signal(range(self.beats))
        y = Signal(range(self.rows))
        behind = Signal()  # the image is complete: the trailer is next
        row_ends = Signal()
        ends = Signal()
        taken = Signal()
        m.d.comb += [
            row_ends.eq(x == self.beats - 1),
            ends.eq(row_ends & (y == self.rows - 1)),
            taken.eq(port.tvalid & port.tready),
        ]
        with m.If(taken & ~behind):
            m.d.sync += x.eq(Mux(row_ends, 0, x + 1))
            with m.If(row_ends):
                m.d.sync += y.eq(Mux(ends, 0, y + 1))
            with m.If(ends):
                m.d.sync += behind.eq(1)
        with m.If(taken & behind & port.tlast):
            m.d.sync += behind.eq(0)

        # Beats of the image: those of `i`, or of what a reset has left open, the first of which may be
        # offered.
        closing = Signal()
        offered = Signal()
        offer = Signal.like(self.i.payload, reset_less=True)
        beat = Signal.like(self.i.payload)
        bits = 8 * self.octets
        m.d.comb += beat.eq(self.i.payload)
        if self.void_octets:
            with m.If(row_ends):
                m.d.comb += beat[bits - 8 * self.void_octets :].eq(0)
        m.d.comb += port.tkeep.eq((1 << self.octets) - 1)
        with m.If(behind):
            m.d.comb += [
                port.tvalid.eq(trailer.o.valid),
                port.tdata.eq(trailer.o.payload.bytes),
                port.tlast.eq(trailer.o.payload.last),
                trailer.o.ready.eq(port.tready),
            ]
        with m.Elif(closing):
            m.d.comb += [port.tvalid.eq(1), port.tdata.eq(Mux(offered, offer, 0))]
        with m.Else():
            m.d.comb += [
                port.tvalid.eq(self.i.valid),
                port.tdata.eq(beat),
                self.i.ready.eq(port.tready),
            ]

        # The record of a packet that was cut takes the place of the one that will not come.
        aborting = Signal()
        m.d.comb += [
            trailer.i.valid.eq(self.record.valid | aborting),
            trailer.i.payload.eq(Mux(aborting, self.aborted, self.record.payload)),
            self.record.ready.eq(trailer.i.ready & ~aborting),
        ]
        with m.If(trailer.i.ready):
            m.d.sync += aborting.eq(0)
        with m.If(closing & taken):
            m.d.sync += [offered.eq(0), closing.eq(~ends)]
        complete = trailer.o.valid & (behind | (taken & ends))
        with m.If(self.cut & ~closing & ~complete):
            waits = self.i.valid & ~port.tready & ~behind
            inside = Mux(taken, ~ends, (x != 0) | (y != 0)) & ~behind
            m.d.comb += trailer.drop.eq(1)
            m.d.sync += [
                aborting.eq(waits | inside | behind | (taken & ends)),
                closing.eq(waits | inside),
                offered.eq(waits),
                offer.eq(beat),
            ]
        return m
