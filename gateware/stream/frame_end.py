"""The end of each frame of a stream, by counting its beats."""

from amaranth import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


class FrameEnd(wiring.Component):
    """Tell when the last beat of a frame of `beats` beats is taken.

    Members
    -------
    taken : a beat is taken in this clock
    done : high in the clock in which a frame's last beat is taken
    """

    def __init__(self, beats: int):
        if beats < 1:
            raise ValueError(f"beats {beats}: expected at least 1")
        self.beats = beats
        super().__init__({"taken": In(1), "done": Out(1)})

    def elaborate(self, platform):
        m = Module()
        place = Signal(range(self.beats))
        last = Signal()
        m.d.comb += [last.eq(place == self.beats - 1), self.done.eq(self.taken & last)]
        with m.If(self.taken):
            m.d.sync += place.eq(Mux(last, 0, place + 1))
        return m
