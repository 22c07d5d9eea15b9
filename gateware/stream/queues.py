# amaranth: UnusedElaboratable=no
"""Queues: a skid buffer that cuts the `ready` path, a FIFO that costs no clock, and credits for a whole
pipeline."""

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import fifo, stream, wiring
from amaranth.lib.wiring import In, Out


class SkidBuffer(wiring.Component):
    """Skid buffer: a FIFO of two beats that cuts the combinational path of `ready`.

    Members
    -------
    i, o : streams of `payload`

    `latency` = 1 clock, initiation interval 1; `i.ready` and `o.valid` come from registers.
    """

    latency = 1

    def __init__(self, payload):
        super().__init__({"i": In(stream.Signature(payload)), "o": Out(stream.Signature(payload))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFO(width=len(Value.cast(self.i.payload)), depth=2)
        m.d.comb += [
            queue.w_data.eq(self.i.payload),
            queue.w_en.eq(self.i.valid),
            self.i.ready.eq(queue.w_rdy),
            self.o.payload.eq(queue.r_data),
            self.o.valid.eq(queue.r_rdy),
            queue.r_en.eq(self.o.ready),
        ]
        return m


class BypassQueue(wiring.Component):
    """FIFO of `depth` beats that a beat passes in the same clock while it is empty and `o` is ready.

    Members
    -------
    i, o : streams of `payload`

    `latency` = 0, initiation interval 1; `i.ready` comes from a register.
    """

    latency = 0

    def __init__(self, payload, *, depth: int):
        if depth < 1:
            raise ValueError(f"depth {depth}: expected at least 1")
        self.depth = depth
        super().__init__({"i": In(stream.Signature(payload)), "o": Out(stream.Signature(payload))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = fifo.SyncFIFO(width=len(Value.cast(self.i.payload)), depth=self.depth)
        m.d.comb += [
            queue.w_data.eq(self.i.payload),
            queue.w_en.eq(self.i.valid & (queue.r_rdy | ~self.o.ready)),
            queue.r_en.eq(self.o.ready),
            self.i.ready.eq(queue.w_rdy),
            self.o.valid.eq(queue.r_rdy | self.i.valid),
            self.o.payload.eq(Mux(queue.r_rdy, queue.r_data, self.i.payload)),
        ]
        return m


class CreditQueue(wiring.Component):
    """Output FIFO of a pipeline without clock enables, with credit-based flow control.

    A beat may enter the pipeline only while the FIFO has a free place for it and for every beat already
    inside. The pipeline itself therefore never stalls, and `o.ready` needs no path to all of its registers.
    W. J. Dally, B. Towles, Principles and Practices of Interconnection Networks (2004), ch. 13.

    Members
    -------
    room : high while a credit is free, that is, a beat may enter the pipeline; from a register
    launch : high for one clock for each beat that enters the pipeline; must be low while `room` is low
    i, i_valid : the pipeline's last register, and whether it holds a beat
    o : stream of `payload`

    `latency` = 0: without back-pressure a beat goes from `i` to `o` in the same clock. A pipeline of fewer
    than `depth` registers accepts one beat per clock. No beat is lost.
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
        """FIFO depth for one beat per clock: the smallest power of two above the pipeline's `registers`."""
        return 1 << registers.bit_length()

    def elaborate(self, platform):
        m = Module()
        taken = Signal()
        under_way = Signal(range(self.depth + 1))
        full = Signal()
        following = (under_way + self.launch - taken)[: len(under_way)]
        m.d.comb += [taken.eq(self.o.valid & self.o.ready), self.room.eq(~full)]
        m.d.sync += [under_way.eq(following), full.eq(following == self.depth)]

        m.submodules.queue = queue = BypassQueue(self.o.payload.shape(), depth=self.depth)
        m.d.comb += [queue.i.payload.eq(self.i), queue.i.valid.eq(self.i_valid)]
        wiring.connect(m, queue.o, wiring.flipped(self.o))
        return m
