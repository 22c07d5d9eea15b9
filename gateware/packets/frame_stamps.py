"""Number, time and mark of each frame that comes in, for records that cannot wait for its result."""

from amaranth import Module, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.bus.result_registers import flags_word, record_value

STAMP = data.StructLayout({"number": 32, "bad": 1, "time": 64})
"""number: of the frame, from 1 since reset; bad: its input was repaired; time: when its first beat was
accepted."""


def stamp_record(stamp) -> Value:
    """The record of a frame of which only its stamp is known; its flag `complete` is 0."""
    return record_value(
        FRAME=stamp.number,
        FLAGS=flags_word(bad=stamp.bad),
        TIME_LOW=stamp.time[:32],
        TIME_HIGH=stamp.time[32:],
    )


class FrameStamps(wiring.Component):
    """Stamp frames as FrameTimer does, without waiting for any result.

    Members
    -------
    accepted, frame_started, frame_done, frame_bad, flush : as for FrameTimer
    time : unsigned(64), clocks since reset
    stamp : of the last whole frame, from the clock after its `frame_done` to the next one's
    """

    def __init__(self):
        names = ("accepted", "frame_started", "frame_done", "frame_bad", "flush")
        super().__init__({**{name: In(1) for name in names}, "time": In(64), "stamp": Out(STAMP)})

    def elaborate(self, platform):
        m = Module()
        # FrameGuard registers one beat: the one that starts a frame is the last one accepted.
        accepted_at = Signal(64, reset_less=True)
        first = Signal(64, reset_less=True)
        with m.If(self.accepted):
            m.d.sync += accepted_at.eq(self.time)
        with m.If(self.frame_started):
            m.d.sync += first.eq(accepted_at)
        with m.If(self.frame_done & ~self.flush):
            m.d.sync += [
                self.stamp.number.eq(self.stamp.number + 1),
                self.stamp.bad.eq(self.frame_bad),
                self.stamp.time.eq(first),
            ]
        return m
