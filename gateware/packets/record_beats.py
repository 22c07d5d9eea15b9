"""A record as the beats of a stream."""

from amaranth import Module, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.record import RECORD_BYTES


class RecordBeats(wiring.Component):
    """Send each record as ceil(`record_octets` / `octets`) beats, its first bytes first.

    Members
    -------
    i : stream of records, 8 · record_octets bits
    drop : forget the record that is held; one that is taken from `i` in this clock too
    o : stream of beats: `bytes`, with zeros behind the record in a beat that is larger, and `last`

    `latency` = 1 clock. A record is taken from `i` while none is held, so that the next one's first beat
    comes a clock after this one's last. `i.ready`, `o.valid` and `o.payload` come from registers.
    """

    latency = 1

    def __init__(self, octets: int, *, record_octets: int = RECORD_BYTES):
        self.octets, self.record_octets = octets, record_octets
        self.beats = -(-record_octets // octets)
        beat = data.StructLayout({"bytes": unsigned(8 * octets), "last": 1})
        super().__init__(
            {
                "i": In(stream.Signature(unsigned(8 * record_octets))),
                "drop": In(1),
                "o": Out(stream.Signature(beat)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        held = Signal()
        rest = Signal(8 * self.octets * self.beats, reset_less=True)
        beat = Signal(range(self.beats))
        last = Signal()
        m.d.comb += [
            last.eq(beat == self.beats - 1),
            self.i.ready.eq(~held),
            self.o.valid.eq(held),
            self.o.payload.bytes.eq(rest),
            self.o.payload.last.eq(last),
        ]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += [beat.eq(beat + 1), rest.eq(rest >> 8 * self.octets)]
            with m.If(last):
                m.d.sync += [beat.eq(0), held.eq(0)]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [held.eq(1), rest.eq(self.i.payload)]
        with m.If(self.drop):
            m.d.sync += [held.eq(0), beat.eq(0)]
        return m
