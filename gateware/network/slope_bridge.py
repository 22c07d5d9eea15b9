"""Slopes under marker dots taken from the skin beside them, while the pixels pass."""

from amaranth import Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_lanes, pace
from fastac.models.integer.slope_bridge import SlopeBridge


class SlopeBridgeStream(wiring.Component):
    """Bridge the slopes of dark pixels, bit-exact to `bridge(slopes, dark)`.

    A window of beats moves along the row. A row's last beats leave it as the next row comes in, or by
    themselves if none comes.

    Members
    -------
    i : stream of beats of `lanes` pixels, rows of W pixels: `slopes` (p, q), signed(slope_bits) each; `over`,
        a bit for each slope: it saturated; `dark`, a bit for each pixel
    o : the same without `dark`; `over` is of the slopes that were taken

    `latency` = fold · (ceil(reach/lanes) + 1) + 1 clocks, without back-pressure, for beats `fold` clocks
    apart: the beats ahead, window and choice. Initiation interval: 1 clock per beat; after a row the beats
    that waited for it leave `fold` clocks apart.
    """

    multipliers = 0

    def __init__(self, bridge: SlopeBridge, *, slope_bits: int, lanes: int, fold: int = 1):
        check_lanes(lanes)
        self.bridge, self.lanes, self.fold = bridge, lanes, fold
        self.row_beats = bridge.windows.image[1] // lanes
        self.ahead = self.beats_ahead(bridge.reach, lanes)
        if self.row_beats <= self.ahead:
            raise ValueError(
                f"reach {bridge.reach}: expected less than a row of {bridge.windows.image[1]} px"
            )
        slopes = data.ArrayLayout(data.ArrayLayout(signed(slope_bits), 2), lanes)
        bridged = {"slopes": slopes, "over": data.ArrayLayout(2, lanes)}
        super().__init__(
            {
                "i": In(stream.Signature(data.StructLayout(bridged | {"dark": lanes}))),
                "o": Out(stream.Signature(data.StructLayout(bridged))),
            }
        )

    @staticmethod
    def beats_ahead(reach: int, lanes: int) -> int:
        """How many beats after its own a pixel may take its slopes from."""
        return -(-reach // lanes)

    @classmethod
    def latency_of(cls, reach: int, lanes: int, fold: int = 1) -> int:
        return fold * (cls.beats_ahead(reach, lanes) + 1) + 1

    @property
    def latency(self) -> int:
        return self.latency_of(self.bridge.reach, self.lanes, self.fold)

    def elaborate(self, platform):
        m = Module()
        ahead, beat = self.ahead, self.i.payload.shape()
        window = [Signal(beat, name=f"beat_{k}", reset_less=True) for k in range(2 * ahead + 1)]
        here = Signal(ahead + 1)  # whether the window's middle and what follows it are beats of a frame
        entering = Signal(range(self.row_beats))
        column = Signal(range(self.row_beats))  # of the window's middle
        free, move = Signal(), Signal()
        due = pace(m, move, self.fold)  # the window may move without a beat
        m.d.comb += [
            free.eq(self.o.ready | ~self.o.valid),
            # Between rows the window may move on without a beat; its oldest beats are then of a row.
            move.eq(free & (self.i.valid | ((entering == 0) & here[0] & due))),
            self.i.ready.eq(free),
        ]
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.If(move):
            m.d.sync += [
                *(
                    older.eq(newer)
                    for older, newer in zip(window, [*window[1:], self.i.payload], strict=True)
                ),
                here.eq((here >> 1) | self.i.valid << ahead),
                self.o.valid.eq(here[0]),
            ]
            with m.If(self.i.valid):
                m.d.sync += entering.eq(Mux(entering == self.row_beats - 1, 0, entering + 1))
            with m.If(here[0]):
                m.d.sync += column.eq(Mux(column == self.row_beats - 1, 0, column + 1))
            for lane in range(self.lanes):
                slopes, over = self._chosen(window, column, lane)
                m.d.sync += [
                    self.o.payload.slopes[lane].as_value().eq(slopes),
                    self.o.payload.over[lane].eq(over),
                ]
        return m

    def _chosen(self, window: list, column: Signal, lane: int) -> tuple:
        """The slopes, as one word, and their `over` that a lane of the window's middle beat gets."""
        middle = window[self.ahead]
        own = middle.slopes[lane].as_value(), middle.over[lane]
        found = own
        for distance in range(self.bridge.reach, 0, -1):
            for step in (distance, -distance):  # the later choice comes first: left before right
                beat, other = divmod(lane + step, self.lanes)
                source = window[self.ahead + beat]
                skin = ~source.dark[other]
                if beat:
                    skin &= column < self.row_beats - beat if beat > 0 else column >= -beat
                values = source.slopes[other].as_value(), source.over[other]
                found = tuple(Mux(skin, new, old) for new, old in zip(values, found, strict=True))
        return tuple(Mux(middle.dark[lane], new, old) for new, old in zip(found, own, strict=True))
