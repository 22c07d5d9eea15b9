# amaranth: UnusedElaboratable=no
"""The end of a pipeline that never rests: what the output cannot take waits here."""

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import fifo, stream, wiring
from amaranth.lib.wiring import In, Out


class SkidBuffer(wiring.Component):
    """Two beats deep, `latency` 1: `ready` and `valid` on both sides come from registers alone."""

    latency = 1

    def __init__(self, payload):
        super().__init__({"i": In(stream.Signature(payload)), "o": Out(stream.Signature(payload))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFO(width=self.i.payload.shape().size, depth=2)
        m.d.comb += [
            queue.w_data.eq(self.i.payload),
            queue.w_en.eq(self.i.valid),
            self.i.ready.eq(queue.w_rdy),
            self.o.payload.eq(queue.r_data),
            self.o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.o.ready),
        ]
        return m


class CreditQueue(wiring.Component):
    """Let beats set off into a pipeline only while there is room for all that are under way.

    So the pipeline's registers need no enable, which would reach every one of them from `o.ready` within one
    clock. Credit-based flow control: W. J. Dally, B. Towles, Principles and Practices of Interconnection
    Networks (2004), ch. 13.

    Members
    -------
    room : high if a beat may set off; from a register
    launch : high for one clock for each beat that sets off
    i, i_valid : the pipeline's last register, and whether it holds a beat
    o : stream of the beats

    Without a stall a beat goes from `i` to `o` in the same clock, `latency` = 0, and a pipeline of fewer than
    `depth` registers takes a beat a clock. No beat is ever lost while `launch` heeds `room`.
    """

    latency = 0

    def __init__(self, payload, *, depth: int):
        if depth < 1:
            raise ValueError(f"depth {depth}: expected at least 1")
        self.depth = depth
        super().__init__(
            {
                "room": Out(1),
                "launch": In(1),
                "i": In(payload),
                "i_valid": In(1),
                "o": Out(stream.Signature(payload)),
            }
        )

    @staticmethod
    def depth_of(registers: int) -> int:
        """The least power of two above a pipeline's `registers`."""
        return 1 << registers.bit_length()

    def elaborate(self, platform):
        m = Module()
        taken = Signal()
        under_way, full = Signal(range(self.depth + 1)), Signal()
        following = (under_way + self.launch - taken)[: len(under_way)]
        m.d.comb += [taken.eq(self.o.valid & self.o.ready), self.room.eq(~full)]
        m.d.sync += [under_way.eq(following), full.eq(following == self.depth)]

        m.submodules.queue = queue = fifo.SyncFIFO(width=len(Value.cast(self.i)), depth=self.depth)
        m.d.comb += [
            queue.w_data.eq(self.i),
            queue.w_en.eq(self.i_valid & (queue.r_rdy | ~self.o.ready)),
            queue.r_en.eq(self.o.ready),
            self.o.valid.eq(queue.r_rdy | self.i_valid),
            self.o.payload.eq(Mux(queue.r_rdy, queue.r_data, self.i)),
        ]
        return m
