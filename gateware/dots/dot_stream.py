# amaranth: UnusedElaboratable=no
"""Marker dots from pixels: their shifts, one after another once the last row is in that a dot can be in."""

from amaranth import Module, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.dots.darkness import DarknessStream
from fastac.gateware.dots.follower import DotFollowerStream, dot_layout
from fastac.gateware.dots.window_stream import DotWindowStream
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_windows import CELL


class DotStream(wiring.Component):
    """Find the shifts of the dots of each frame, bit-exact to `follower(follower.windows(frames))`.

    Members
    -------
    i : stream of `lanes` pixels of C × unsigned(8), frames of H × W pixels in raster order
    o : stream of one dot per beat, see `dot_layout`; M of them a frame, in the order of `follower.rest`
    threshold : see `DarknessStream`; only if `follower.windows.loadable`. Places and limits stay as built.

    `latency` clocks from a frame's last pixels to its last dot, without back-pressure; it is negative where
    the last dot is known before the frame ends. `interval` = H·W/lanes clocks per frame. Raises ValueError
    where dots are too many for the rate, see `DotFollowerStream`.
    """

    multipliers = 0

    def __init__(self, follower: DotFollower, *, lanes: int):
        self.follower, self.lanes = follower, lanes
        windows = follower.windows
        self.height, self.width = windows.image
        self.darkness = DarknessStream(windows, lanes=lanes)
        self.windows = DotWindowStream(windows, lanes=lanes)
        row_clocks = CELL * self.width // lanes
        self.dots = DotFollowerStream(follower, per_beat=self.windows.per_beat, row_clocks=row_clocks)
        pixel = data.ArrayLayout(unsigned(8), windows.channels)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
            "o": Out(stream.Signature(dot_layout(follower))),
        }
        if windows.loadable:
            members["threshold"] = In(self.darkness.table.signature)
        super().__init__(members)

    @property
    def latency(self) -> int:
        return self.darkness.latency + self.windows.latency + self.dots.latency

    @property
    def interval(self) -> int:
        return self.height * self.width // self.lanes

    def elaborate(self, platform):
        m = Module()
        m.submodules.darkness = darkness = self.darkness
        m.submodules.windows = windows = self.windows
        m.submodules.dots = dots = self.dots
        wiring.connect(m, wiring.flipped(self.i), darkness.i)
        wiring.connect(m, darkness.o, windows.i)
        wiring.connect(m, windows.o, dots.i)
        wiring.connect(m, dots.o, wiring.flipped(self.o))
        if self.follower.windows.loadable:
            wiring.connect(m, wiring.flipped(self.threshold), darkness.threshold)
        return m
