# amaranth: UnusedElaboratable=no
"""Marker dots from darkness: their shifts, one after another once the last row is in that a dot can be in."""

from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.dots.follower import DotFollowerStream, dot_layout
from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_windows import CELL


class DotStream(wiring.Component):
    """Find the shifts of each frame's dots, bit-exact to `follower(follower.windows.of_darkness(darkness))`.

    Members
    -------
    i : stream of the darkness of `lanes` pixels, see `DarknessStream.o`
    o : stream of one dot per beat, see `dot_layout`; M of them a frame, in the order of `follower.rest`
    write : see `DotFollowerStream`. Only if `follower.loadable`.

    `latency` clocks from a frame's last pixels to its last dot, without back-pressure; it is negative where
    the last dot is known before the frame ends. `interval` = fold·H·W/lanes clocks per frame: pixels come
    `fold` clocks apart, or later. Raises ValueError where dots are too many for the rate, see
    `DotFollowerStream`.
    """

    multipliers = 0

    def __init__(self, follower: DotFollower, *, lanes: int, fold: int = 1):
        self.follower, self.lanes, self.fold = follower, lanes, fold
        windows = follower.windows
        self.height, self.width = windows.image
        self.windows = DotWindowStream(windows, lanes=lanes)
        row_clocks = CELL * self.width // lanes * fold
        self.dots = DotFollowerStream(follower, per_beat=self.windows.per_beat, row_clocks=row_clocks)
        members = {
            "i": In(self.windows.i.signature.flip()),
            "o": Out(stream.Signature(dot_layout(follower))),
        }
        if follower.loadable:
            members["write"] = In(self.dots.table.format.signature)
        super().__init__(members)

    @property
    def latency(self) -> int:
        return self.windows.latency + self.dots.latency

    @property
    def interval(self) -> int:
        return self.height * self.width // self.lanes * self.fold

    def elaborate(self, platform):
        m = Module()
        m.submodules.windows = windows = self.windows
        m.submodules.dots = dots = self.dots
        wiring.connect(m, wiring.flipped(self.i), windows.i)
        wiring.connect(m, windows.o, dots.i)
        wiring.connect(m, dots.o, wiring.flipped(self.o))
        if self.follower.loadable:
            wiring.connect(m, wiring.flipped(self.write), dots.write)
        return m
