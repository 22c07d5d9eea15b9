"""Repair of the video input: whole frames of H × W pixels, whatever arrives on the AXI4-Stream."""

from amaranth import Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import axis_signature

FRAMES_IN_FLIGHT = 8
"""Depth of the FIFOs with one word per frame in flight; every datapath holds fewer frames than this."""
FRAME_FAULTS = ("line_short", "line_long", "frame_short", "frame_long", "no_start", "frame_timeout")
"""Outputs of FrameGuard that pulse when the input breaks the frame format."""
TIMEOUT_BITS = 32
EVENTS = ("accepted", "frame_started", "frame_done", "frame_bad")
"""Outputs of FrameGuard from which FrameTimer counts and times the frames."""


class State(enum.Enum):
    WAIT = 0  # between frames, waiting for a start of frame
    LINE = 1  # inside a line, forwarding beats
    DROP = 2  # the line is complete but `tlast` has not come: drop beats until it comes
    PAD = 3  # the line ended early: pad it with its last pixel
    FILL = 4  # the frame ended early: pad it with its last pixel


class FrameGuard(wiring.Component):
    """Turn an AXI4-Stream of video lines into frames of exactly H lines, repairing and reporting faulty ones.

    Members
    -------
    axis : AXI4-Stream slave. `tdata`: unsigned(8 · channels · lanes), lane 0 and channel 0 in the least
        significant bits; `tlast`: last beat of each line; `tuser`: first beat of each frame.
    enable : sampled with each start of frame that `axis` accepts; if low, that whole frame is dropped, and no
        fault is reported for it
    hold : while high, no frame starts: its first beat waits here and `axis` is stalled
    timeout : clocks without a beat after which an unfinished frame counts as abandoned; 0: never. Clocks in
        which a beat waits for `o` do not count.
    o : stream of `lanes` pixels of `channels` unsigned(8), exactly `beats` = H · W/lanes beats per frame
    tag : stream of one unsigned(1) per frame, valid in the clock after the frame's last beat left `o`: 1 if
        the frame is bad. While it is not taken, the last beat of the next frame waits; earlier beats do not.
    accepted : high in each clock in which `axis` accepts a beat
    frame_started : pulse when a frame's first beat moves to the output register
    frame_done : pulse when a frame's last beat, received or padded, moves to the output register
    frame_bad : valid with `frame_done`: the frame is bad
    line_short : pulse: `tlast` came before the line was complete. The line is padded with its last pixel.
    line_long : pulse: the line was complete without `tlast`. Beats up to the next `tlast` are dropped.
    frame_short : pulse: a start of frame came inside a frame. The old frame is padded with its last pixel;
        the beat that starts the new one waits until then.
    frame_long : pulse: a beat that is not a start of frame came after a complete frame. It and the following
        beats are dropped up to the next start of frame; they are reported once.
    no_start : the same before the first frame since reset
    frame_timeout : pulse: no beat came for `timeout` clocks inside a frame. The frame is padded with its last
        pixel. Its beats that come later are dropped without another report.

    A frame is bad if `line_short`, `line_long`, `frame_short` or `frame_timeout` occurred in it. `frame_long`
    does not make the frame before it bad, since that frame may already have left; so what is marked does not
    depend on timing. A line without `tlast` also ends at the next start of frame.

    `latency` = 2 clocks from an accepted beat to the same beat at `o`, without back-pressure. Initiation
    interval: 1 clock per beat, also between frames, while frames are good. Padding takes one clock per padded
    beat and one clock to begin. There is no combinational path from inputs to outputs of `axis`.
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
                "timeout": In(TIMEOUT_BITS),
                "o": Out(stream.Signature(data.ArrayLayout(pixel, lanes))),
                "tag": Out(stream.Signature(unsigned(1))),
                **{name: Out(1) for name in (*EVENTS, *FRAME_FAULTS)},
            }
        )

    def elaborate(self, platform):
        m = Module()

        # Input register: decisions depend on the beat held here, so `tready` does not depend on `tdata` etc.
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

        # Position (x, y) of the next beat to send, and whether the output has room for it.
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
        waits = Signal()  # an unfinished frame needs another beat
        reported = Signal()  # the surplus beats since the last frame have been reported
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
                m.d.comb += waits.eq(~held)
            with m.Case(State.DROP):
                # (x, y) is already the start of the next line, or of the next frame if y is 0.
                with m.If(held & start):
                    with m.If(y == 0):
                        m.d.sync += state.eq(State.WAIT)
                    with m.Else():
                        m.d.comb += self.frame_short.eq(1)
                with m.Else():
                    m.d.comb += [take.eq(held), waits.eq(~held & (y != 0))]
                    with m.If(held & last):
                        m.d.sync += state.eq(Mux(y == 0, State.WAIT, State.LINE))
            with m.Default():
                m.d.comb += [made_up.eq(1), send.eq(room)]

        # The comparison has a clock of its own; a lower `timeout` also ends a wait that is under way.
        waited = Signal(TIMEOUT_BITS, init=1)  # clocks waited, with this one
        expired = Signal()
        m.d.comb += self.frame_timeout.eq(waits & expired)
        m.d.sync += expired.eq(waits & self.timeout.any() & (waited >= self.timeout))
        with m.If(~waits):
            m.d.sync += waited.eq(1)
        with m.Elif(~waited.all()):
            m.d.sync += waited.eq(waited + 1)

        received = send & ~made_up
        m.d.comb += [
            self.line_short.eq(received & last & ~line_ends),
            self.line_long.eq(received & ~last & line_ends),
        ]
        with m.If(self.frame_started):
            m.d.sync += [seen.eq(1), reported.eq(0)]
        with m.If(self.frame_short | self.frame_timeout):
            m.d.sync += state.eq(State.FILL)
        with m.If(self.frame_timeout):
            m.d.sync += reported.eq(1)
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
        with m.Elif(Cat(self.line_short, self.line_long, self.frame_short, self.frame_timeout).any()):
            m.d.sync += bad.eq(1)

        # The output register also keeps the last pixel, which padding repeats.
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
