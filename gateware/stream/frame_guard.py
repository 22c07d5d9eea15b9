"""Whole frames of H × W pixels from whatever a camera sends."""

from amaranth import Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import axis_signature

FRAMES_IN_FLIGHT = 8
"""Depth of the queues that keep a word for each frame until its results come; no datapath holds so many."""


FRAME_FAULTS = ("line_short", "line_long", "frame_short", "frame_long", "no_start")
EVENTS = ("accepted", "frame_started", "frame_done", "frame_bad")


class State(enum.Enum):
    WAIT = 0  # between frames: for the next start of frame
    LINE = 1  # inside a line
    DROP = 2  # behind a line that is complete but has not ended: until its end
    PAD = 3  # in a line that ended early: to its end
    FILL = 4  # in a frame that ended early: to its end


class FrameGuard(wiring.Component):
    """Turn an AXI4-Stream of video lines into whole frames; never hang, never lose synchronism.

    Members
    -------
    axis : AXI4-Stream in, `tdata` unsigned(8 · channels · lanes) with lane 0 and channel 0 lowest, `tlast`
        at the end of each line, `tuser` at the first beat of each frame
    enable : counts as `axis` takes a start of frame: where it is low, that frame is dropped whole, without
        a flag of its own
    hold : a frame that has not left yet waits with its start, and `axis` waits behind it
    o : stream of `lanes` pixels of `channels` unsigned(8), exactly `beats` beats for each frame
    tag : stream of one unsigned(1) a frame, offered in the clock after the frame's last beat left `o`: 1 if
        the frame is bad. It holds back the last beat of the next frame, not more, until it is taken.
    accepted : high in each clock in which `axis` takes a beat
    frame_started : pulse as a frame's first beat moves on towards `o`
    frame_done : pulse as a frame's last beat, received or made up, moves on towards `o`
    frame_bad : with `frame_done`: the frame is bad
    line_short : pulse: `tlast` before the line was complete. The rest of the line repeats its last pixel.
    line_long : pulse: a line's last beat without `tlast`. Beats up to the next `tlast` are dropped.
    frame_short : pulse: start of frame inside a frame, in whatever line. The old frame is completed with
        its last pixel; the beat that starts the new one waits meanwhile.
    frame_long : pulse: a beat that is no start of frame where one belongs; once for all beats up to the
        next start of frame, which are dropped
    no_start : the same before the first frame since reset

    A frame is bad if `line_short`, `line_long` or `frame_short` came in it. Beats behind a frame's last
    line cannot change what was said of it: `frame_long` is reported by its flag alone, and so does not
    depend on timing. A line that lacks `tlast` and meets a start of frame ends there.

    `latency` clocks pass from a beat accepted to the same beat leaving `o`, if nothing stalls, and as long as
    frames are good a beat moves every clock, also from frame to frame. No path leads through from an input
    of `axis` to an output of `axis`. Padding costs one beat a clock; entering it costs one clock.
    """

    latency = 2

    def __init__(self, height: int, width: int, channels: int, *, lanes: int):
        for name, value, least in (("height", height, 2), ("channels", channels, 1), ("lanes", lanes, 1)):
            if value < least:
                raise ValueError(f"{name} {value}: expected at least {least}")
        if width < 1 or width % lanes:
            raise ValueError(f"width {width}: expected a multiple of lanes, {lanes}")
        self.height, self.width, self.channels, self.lanes = height, width, channels, lanes
        self.line_beats = width // lanes
        self.beats = height * self.line_beats
        pixel = data.ArrayLayout(unsigned(8), channels)
        super().__init__(
            {
                "axis": In(axis_signature(8 * channels * lanes)),
                "enable": In(1, init=1),
                "hold": In(1),
                "o": Out(stream.Signature(data.ArrayLayout(pixel, lanes))),
                "tag": Out(stream.Signature(unsigned(1))),
                **{name: Out(1) for name in (*EVENTS, *FRAME_FAULTS)},
            }
        )

    def elaborate(self, platform):
        m = Module()

        # One beat is held here, so that what it is decides what happens and `tready` needs no look at it.
        held = Signal()
        last = Signal(reset_less=True)
        start = Signal(reset_less=True)
        wanted = Signal(reset_less=True)
        pixels = Signal(self.o.payload.shape(), reset_less=True)
        take = Signal()
        m.d.comb += [
            self.axis.tready.eq(~held | take),
            self.accepted.eq(self.axis.tvalid & self.axis.tready),
        ]
        with m.If(self.axis.tready):
            m.d.sync += [
                held.eq(self.axis.tvalid),
                last.eq(self.axis.tlast),
                start.eq(self.axis.tuser),
                wanted.eq(self.enable),
                pixels.eq(self.axis.tdata),
            ]

        # The place of the next beat to leave, and whether it may leave now.
        x = Signal(range(self.line_beats))
        y = Signal(range(self.height))
        line_ends = Signal()
        frame_ends = Signal()
        room = Signal()
        m.d.comb += [
            line_ends.eq(x == self.line_beats - 1),
            frame_ends.eq(line_ends & (y == self.height - 1)),
            room.eq((~self.o.valid | self.o.ready) & ~(frame_ends & self.tag.valid & ~self.tag.ready)),
        ]

        state = Signal(State)
        send = Signal()
        made_up = Signal()
        reported = Signal()  # surplus beats were
        seen = Signal()  # a frame has started since reset
        with m.Switch(state):
            with m.Case(State.WAIT):
                with m.If(start & wanted):
                    m.d.comb += [
                        send.eq(held & room & ~self.hold),
                        take.eq(send),
                        self.frame_started.eq(send),
                    ]
                with m.Else():
                    unexpected = held & ~start & ~reported
                    m.d.comb += [
                        take.eq(held),
                        self.frame_long.eq(unexpected & seen),
                        self.no_start.eq(unexpected & ~seen),
                    ]
                    with m.If(held):
                        m.d.sync += reported.eq(1)
            with m.Case(State.LINE):
                with m.If(start):
                    m.d.comb += self.frame_short.eq(held)
                with m.Else():
                    m.d.comb += [send.eq(held & room), take.eq(send)]
            with m.Case(State.DROP):
                # The place has moved on to the next line, or to the next frame.
                with m.If(held & start):
                    with m.If(y == 0):
                        m.d.sync += state.eq(State.WAIT)
                    with m.Else():
                        m.d.comb += self.frame_short.eq(1)
                with m.Else():
                    m.d.comb += take.eq(held)
                    with m.If(held & last):
                        m.d.sync += state.eq(Mux(y == 0, State.WAIT, State.LINE))
            with m.Default():
                m.d.comb += [made_up.eq(1), send.eq(room)]

        received = send & ~made_up
        m.d.comb += [
            self.line_short.eq(received & last & ~line_ends),
            self.line_long.eq(received & ~last & line_ends),
        ]
        with m.If(self.frame_started):
            m.d.sync += [seen.eq(1), reported.eq(0)]
        with m.If(self.frame_short):
            m.d.sync += state.eq(State.FILL)
        with m.If(send):
            m.d.sync += x.eq(Mux(line_ends, 0, x + 1))
            with m.If(line_ends):
                m.d.sync += y.eq(Mux(frame_ends, 0, y + 1))
            with m.If(self.line_short):
                m.d.sync += state.eq(State.PAD)
            with m.Elif(self.line_long):
                m.d.sync += state.eq(State.DROP)
            with m.Elif(frame_ends):
                m.d.sync += state.eq(State.WAIT)
            with m.Elif(received | (line_ends & (state == State.PAD))):
                m.d.sync += state.eq(State.LINE)

        bad = Signal()
        m.d.comb += [
            self.frame_done.eq(send & frame_ends),
            self.frame_bad.eq(bad | self.line_short | self.line_long),
        ]
        with m.If(self.frame_done):
            m.d.sync += bad.eq(0)
        with m.Elif(Cat(self.line_short, self.line_long, self.frame_short).any()):
            m.d.sync += bad.eq(1)

        # The last register also keeps the pixel that padding repeats.
        closes = Signal()
        closes_bad = Signal(reset_less=True)
        with m.If(~self.o.valid | self.o.ready):
            m.d.sync += self.o.valid.eq(send)
        with m.If(send):
            m.d.sync += [closes.eq(frame_ends), closes_bad.eq(self.frame_bad)]
            for lane in range(self.lanes):
                m.d.sync += self.o.payload[lane].eq(
                    Mux(made_up, self.o.payload[self.lanes - 1], pixels[lane])
                )
        with m.If(self.o.valid & self.o.ready & closes):
            m.d.sync += [self.tag.valid.eq(1), self.tag.payload.eq(closes_bad)]
        with m.Elif(self.tag.ready):
            m.d.sync += self.tag.valid.eq(0)
        return m
