"""Records that wait for the end of their packet, and how many frames may be on the way to theirs."""

from amaranth import Module, Signal, unsigned
from amaranth.lib import fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.record import RECORD_BYTES
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT


class RecordQueue(wiring.Component):
    """FIFO of records that cannot overflow, for it counts the frames that have been let in and will give one.

    Members
    -------
    room : high while another frame may be let in
    enters : high for one clock for each frame that is let in; must be low while `room` is low
    record, record_valid : a frame's record, high for one clock each, in the order of the frames. At most one
        frame more than `enters` has told of may have its record, as that frame may be waiting at the door.
    o : stream of records, `bits` each

    `latency` = 1 clock. At most `frames` − 1 frames have been let in and have their record not taken from
    `o`, so with the one at the door at most `frames` records wait, which is the FIFO's depth: none is lost.
    """

    latency = 1

    def __init__(self, *, frames: int = FRAMES_IN_FLIGHT, bits: int = 8 * RECORD_BYTES):
        if frames < 2:
            raise ValueError(f"frames {frames}: expected at least 2")
        self.frames, self.bits = frames, bits
        record = unsigned(bits)
        super().__init__(
            {
                "room": Out(1, init=1),
                "enters": In(1),
                "record": In(record),
                "record_valid": In(1),
                "o": Out(stream.Signature(record)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFO(width=self.bits, depth=self.frames)
        inside = Signal(range(self.frames))
        leaves = self.o.valid & self.o.ready
        following = (inside + self.enters - leaves)[: len(inside)]
        m.d.sync += [inside.eq(following), self.room.eq(following != self.frames - 1)]
        m.d.comb += [
            queue.w_data.eq(self.record),
            queue.w_en.eq(self.record_valid),
            self.o.payload.eq(queue.r_data),
            self.o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.o.ready),
        ]
        return m
