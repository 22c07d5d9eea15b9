"""Background subtraction: from pixels to the network's features, ΔI of every channel and the coordinates."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.network.light_follower import LightFollower, is_lit, shifted
from fastac.gateware.stream.handshake import check_lanes, pipeline_handshake
from fastac.models.integer.features import WIDTH


def _check_coordinates(name: str, codes: np.ndarray, size: int) -> None:
    if np.shape(codes) != (size,):
        raise ValueError(f"{name} {np.shape(codes)}: expected ({size},)")
    limit = 1 << (WIDTH - 1)
    if np.min(codes) < -limit or np.max(codes) >= limit:
        raise ValueError(f"{name} {np.min(codes)} to {np.max(codes)}: expected {-limit} to {limit - 1}")


class BackgroundSubtraction(wiring.Component):
    """Subtract the stored background and add the coordinates, bit-exact to `integer_features`.

    Members
    -------
    i : stream of `lanes` pixels of `channels` × unsigned(8), whole frames in raster order
    o : stream of `lanes` feature vectors of channels + 2 values, signed(9) each: ΔI = pixel − background of
        every channel, then coordinate_u of the pixel's column, then coordinate_v of its row
    capture : sampled with the first accepted beat of a frame; if high, this frame becomes the background: its
        own ΔI are zero, and those of later frames are differences from it
    captured : high in the clock in which the last beat of such a frame is accepted. If a reset cuts the frame
        short, the background holds part of it, and `captured` stays low, until a whole frame is captured.
    shifted : the pixels that the features on `o` are of, shaped as `i`. Only with `level_light`.

    With `level_light` each frame's pixels are shifted first as `models.integer.light_level.followed`
    says (LightFollower); a captured frame is not, and leaves the shifts as they are. A row must then have 4
    beats at least.

    The background is a block RAM with one word per beat: height·width/lanes words of 8·channels·lanes bits.
    Its initial content is `background`; a reset does not restore that.
    `latency` = 3 clocks (memory read, its output register, difference), and 1 for the shift with
    `level_light`, without back-pressure; initiation interval 1.
    """

    def __init__(
        self,
        height: int,
        width: int,
        channels: int,
        coordinate_u: np.ndarray,
        coordinate_v: np.ndarray,
        background: np.ndarray,
        *,
        lanes: int,
        level_light: bool = False,
    ):
        check_lanes(lanes)
        if width % lanes:
            raise ValueError(f"width {width}: expected a multiple of {lanes} lanes")
        if level_light and width // lanes < 4:
            raise ValueError(f"width {width}: expected at least {4 * lanes} with level_light")
        _check_coordinates("coordinate_u", coordinate_u, width)
        _check_coordinates("coordinate_v", coordinate_v, height)
        background = np.asarray(background)
        shape = (height, width, channels)
        if background.shape != shape or background.dtype != np.uint8:
            raise ValueError(f"background {background.shape} {background.dtype}: expected {shape} uint8")
        self.coordinate_u, self.coordinate_v = np.array(coordinate_u), np.array(coordinate_v)
        self.background, self.lanes, self.level_light = background, lanes, level_light
        pixel = data.ArrayLayout(unsigned(8), channels)
        features = data.ArrayLayout(signed(WIDTH), channels + 2)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(features, lanes))),
                "capture": In(1),
                "captured": Out(1),
            }
            | ({"shifted": Out(data.ArrayLayout(pixel, lanes))} if level_light else {})
        )

    @staticmethod
    def latency_of(*, level_light: bool) -> int:
        return 3 + level_light

    @property
    def latency(self) -> int:
        return self.latency_of(level_light=self.level_light)

    def elaborate(self, platform):
        m = Module()
        height, width, channels = self.background.shape
        beats = width // self.lanes

        # One clock enable for all registers, also those of the memories: all stages stall together.
        advance = pipeline_handshake(m, self.i, self.o, self.latency)

        # Position of the next beat.
        address, beat, row = Signal(range(height * beats)), Signal(range(beats)), Signal(range(height))
        line_ends, first, last = Signal(), Signal(), Signal()
        accept, own, capturing = Signal(), Signal(), Signal()
        m.d.comb += [
            line_ends.eq(beat == beats - 1),
            first.eq(address == 0),
            last.eq(address == height * beats - 1),
            accept.eq(self.i.valid & advance),
            own.eq(Mux(first, self.capture, capturing)),  # this frame becomes the background
            self.captured.eq(accept & own & last),
        ]
        with m.If(accept):
            m.d.sync += [
                address.eq(Mux(last, 0, address + 1)),
                beat.eq(Mux(line_ends, 0, beat + 1)),
                capturing.eq(own & ~last),
            ]
            with m.If(line_ends):
                m.d.sync += row.eq(Mux(last, 0, row + 1))

        # One word per beat; a captured word is first read a frame later.
        words = [row.tobytes() for row in self.background.reshape(height * beats, -1)]
        m.submodules.background = background = Memory(
            shape=unsigned(8 * channels * self.lanes),
            depth=len(words),
            init=[int.from_bytes(word, "little") for word in words],
            attrs={"ram_style": "block"},
        )
        write = background.write_port()
        m.d.comb += [
            write.addr.eq(address),
            write.data.eq(self.i.payload),
            write.en.eq(accept & own),
        ]
        m.submodules.u = u = Memory(
            shape=data.ArrayLayout(signed(WIDTH), self.lanes),
            depth=beats,
            init=self.coordinate_u.reshape(beats, self.lanes).tolist(),
        )
        m.submodules.v = v = Memory(shape=signed(WIDTH), depth=height, init=self.coordinate_v.tolist())

        # The memories' read and output registers, and the pixels delayed by as many clocks.
        stages = [(self.i.payload, own)]
        for k in range(2):
            pixels = Signal(self.i.payload.shape(), reset_less=True, name=f"pixels_{k}")
            zero = Signal(reset_less=True, name=f"zero_{k}")
            with m.If(advance):
                m.d.sync += [pixels.eq(stages[-1][0]), zero.eq(stages[-1][1])]
            stages.append((pixels, zero))
        outputs = []
        for name, memory, where in (("background", background, address), ("u", u, beat), ("v", v, row)):
            read = memory.read_port()
            output = Signal(memory.shape, reset_less=True, name=f"{name}_output")
            m.d.comb += [read.addr.eq(where), read.en.eq(advance)]
            with m.If(advance):
                m.d.sync += output.eq(read.data)
            outputs.append(output)

        pixels, zero = stages[-1]
        word, coordinate_u, coordinate_v = outputs
        if self.level_light:
            begins, counts = self._places(m, advance, accept & first, accept & (row != height - 1))
            m.submodules.follower = follower = LightFollower(height, width, channels, lanes=self.lanes)
            m.d.comb += [follower.advance.eq(advance), follower.begins.eq(begins)]
            lit = Signal(follower.lit.shape(), reset_less=True)
            moved = Signal(self.i.payload.shape(), reset_less=True)
            later = {"zero": zero, "word": word, "coordinate_u": coordinate_u, "coordinate_v": coordinate_v}
            delayed = {name: Signal.like(value, name=f"{name}_later") for name, value in later.items()}
            lit_features, shifted_pixels = Signal.like(lit), Signal.like(moved)
            with m.If(advance):
                for lane in range(self.lanes):
                    for c in range(channels):
                        known = word.word_select(lane * channels + c, 8)
                        value = shifted(pixels[lane][c], follower.shift[c], is_lit(known) & ~zero)
                        m.d.sync += [lit[lane][c].eq(is_lit(known)), moved[lane][c].eq(value)]
                m.d.sync += [delayed[name].eq(value) for name, value in later.items()]
                m.d.sync += [lit_features.eq(lit), shifted_pixels.eq(moved)]
            pixels, (zero, word, coordinate_u, coordinate_v) = moved, delayed.values()
            m.d.comb += [
                follower.counts.eq(counts),
                follower.lit.eq(lit_features),
                self.shifted.eq(shifted_pixels),
                *(
                    follower.features[lane][c].eq(self.o.payload[lane][c])
                    for lane in range(self.lanes)
                    for c in range(channels)
                ),
            ]
        features = Signal(self.o.payload.shape(), reset_less=True)
        m.d.comb += self.o.payload.eq(features)
        with m.If(advance):
            for lane in range(self.lanes):
                for c in range(channels):
                    known = word.word_select(lane * channels + c, 8)
                    m.d.sync += features[lane][c].eq(Mux(zero, 0, pixels[lane][c] - known))
                m.d.sync += [
                    features[lane][channels].eq(coordinate_u[lane]),
                    features[lane][channels + 1].eq(coordinate_v),
                ]
        return m

    def _places(self, m: Module, advance, first, inner) -> tuple[Signal, Signal]:
        """Where the first beat of a frame is about to be shifted, and where there are features of a beat
        that counts; `first` and `inner` are of the beat that is accepted."""
        begins, counts = Signal(), Signal(self.latency)
        with m.If(advance):
            m.d.sync += [begins.eq(first), counts.eq(Cat(inner, counts))]
        return begins, counts[-1]
