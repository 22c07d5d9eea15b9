"""Packets from a DMA, a frame each, as the marked lines of video that FrameGuard takes."""

from amaranth import Cat, Module, Mux, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.packet_format import FrameFormat
from fastac.gateware.stream.handshake import axis_signature


def packet_signature(octets: int) -> wiring.Signature:
    """AXI4-Stream of packets with `octets` bytes per beat, seen from the master."""
    return wiring.Signature(
        {
            "tdata": Out(unsigned(8 * octets)),
            "tkeep": Out(unsigned(octets)),
            "tvalid": Out(1),
            "tready": In(1),
            "tlast": Out(1),
        }
    )


class PacketInput(wiring.Component):
    """Mark the lines of packets, and end the frame of a packet that was too short.

    It counts beats of the packet, so it must not be reset together with FrameGuard, but only where the source
    of the packets is: then the rest of a packet that a reset of FrameGuard has cut bears no start of frame
    and is dropped there, up to its end.

    Members
    -------
    axis : AXI4-Stream slave. `tdata`: `lanes` pixels of `format.bytes_per_pixel` bytes, of which those beyond
        the channels are ignored; `tlast`: last beat of the packet; `tkeep` is ignored.
    enable : accept frames
    o : to FrameGuard.axis. A packet's first beat is a start of frame, and the last beat of each line and of
        the packet an end of line. Beats beyond a whole frame bear no start of frame, so that FrameGuard drops
        and reports them (frame_long).
    o_enable : to FrameGuard.enable
    accepted : high in each clock in which `axis` accepts a beat

    A packet that ends early inside a line ends that line there (line_short). If it ends before the last line,
    FrameGuard waits for more, so a start of frame is made up that is not enabled: FrameGuard completes the
    frame (frame_short), and drops what was made up. So a frame of a packet is complete without any later
    packet.

    `latency` = 0: while nothing is made up, `axis` and `o` are the same handshake. After a packet `axis` is
    not ready for `pause` clocks, and after a short one for one more, in which `o` takes what is made up.
    """

    latency = 0

    def __init__(self, frame: FrameFormat, *, pause: int = 0):
        if pause < 0:
            raise ValueError(f"pause {pause}: expected at least 0")
        self.frame, self.pause = frame, pause
        super().__init__(
            {
                "axis": In(packet_signature(frame.bytes_per_beat)),
                "enable": In(1, init=1),
                "o": Out(axis_signature(8 * frame.channels * frame.lanes)),
                "o_enable": Out(1),
                "accepted": Out(1),
            }
        )

    def elaborate(self, platform):
        m = Module()
        frame, axis, o = self.frame, self.axis, self.o
        line_beats = frame.width // frame.lanes

        # Place of the next beat in its packet; beyond a whole frame it is `surplus`, and x = y = 0.
        x = Signal(range(line_beats))
        y = Signal(range(frame.height))
        surplus = Signal()
        line_ends = Signal()
        frame_ends = Signal()
        made_up = Signal()  # the packet was too short: end its frame
        waits = Signal(range(self.pause + 1))  # clocks until the next packet may begin
        m.d.comb += [
            line_ends.eq(x == line_beats - 1),
            frame_ends.eq(line_ends & (y == frame.height - 1)),
            axis.tready.eq(o.tready & ~made_up & (waits == 0)),
            self.accepted.eq(axis.tvalid & axis.tready),
        ]
        with m.If(waits != 0):
            m.d.sync += waits.eq(waits - 1)
        with m.If(made_up & o.tready):
            m.d.sync += made_up.eq(0)
        with m.If(self.accepted):
            with m.If(axis.tlast):
                m.d.sync += [
                    *(x.eq(0), y.eq(0), surplus.eq(0)),
                    made_up.eq(~frame_ends & ~surplus),
                    waits.eq(self.pause),
                ]
            with m.Elif(frame_ends):
                m.d.sync += [x.eq(0), y.eq(0), surplus.eq(1)]
            with m.Elif(~surplus):
                m.d.sync += x.eq(Mux(line_ends, 0, x + 1))
                with m.If(line_ends):
                    m.d.sync += y.eq(y + 1)

        stride = 8 * frame.bytes_per_pixel
        pixels = (axis.tdata[lane * stride :][: 8 * frame.channels] for lane in range(frame.lanes))
        m.d.comb += [
            o.tvalid.eq(made_up | (axis.tvalid & (waits == 0))),
            o.tdata.eq(Cat(pixels)),
            o.tuser.eq(made_up | ((x == 0) & (y == 0) & ~surplus)),
            o.tlast.eq(made_up | axis.tlast | (line_ends & ~surplus)),
            self.o_enable.eq(self.enable & ~made_up),
        ]
        return m
