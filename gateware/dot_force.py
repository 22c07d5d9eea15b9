# amaranth: UnusedElaboratable=no
"""The force of skin and marker dots, from the skin's force and the darkness of pixels."""

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.dots.dot_stream import DotStream
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.frame_validity import DOTS_LATENCY
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.pipeline import IntegerPipeline

VALUES = 2
"""Of a dot: its shift along u and v."""


class DotForceStream(wiring.Component):
    """Follow the dots of each frame and add their share to the force of the skin.

    Bit-exact to `pipeline.force(…) + pipeline.dot_force(shifts)`.

    Members
    -------
    darkness : stream of the darkness of `lanes` pixels, see `DarknessStream.o`
    skin : stream of one beat per frame: an accumulator per axis, signed(pipeline.force.width)
    o : the same of skin and dots, signed(pipeline.force_width)
    shifts : stream of one dot per beat, see `dot_layout`. Only if the scene wants slip.
    lost, taken : a dot is followed, M of them a frame; it is lost
    write : see `DotFollowerStream`. Only if `pipeline.follower.loadable`.

    fold : clocks between two beats of darkness at full rate

    `latency` counts from the darkness of a frame's last pixels to the dots' sums, without back-pressure; the
    sum of both parts follows `ForceSum.latency` clocks after the later one.
    """

    def __init__(self, pipeline: IntegerPipeline, *, lanes: int, fold: int = 1, dsp: DspSlice = DSP48E2):
        self.dots = DotStream(pipeline.follower, lanes=lanes, fold=fold)
        weighted = pipeline.dot_force.weighted
        if weighted.input_width != pipeline.follower.width:
            raise ValueError(
                f"dot_force of shifts of {weighted.input_width} bits: the follower's have"
                f" {pipeline.follower.width}"
            )
        self.weighted = WeightedSumStream(weighted, lanes=1, dsp=dsp)
        self.sum = ForceSum(pipeline.dot_force, skin_width=pipeline.force.width, width=pipeline.force_width)
        if self.weighted.latency + self.sum.latency < DOTS_LATENCY:
            raise ValueError(f"flags of dots take {DOTS_LATENCY} clocks: later than the frame's result")
        members = {
            "darkness": In(self.dots.i.signature.flip()),
            "skin": In(self.sum.skin.signature.flip()),
            "o": Out(self.sum.o.signature),
            "lost": Out(1),
            "taken": Out(1),
        }
        self.wants_shifts = pipeline.spread is not None
        if self.wants_shifts:
            members["shifts"] = Out(self.dots.o.signature)
        self.loadable = pipeline.follower.loadable
        if self.loadable:
            members["write"] = In(self.dots.write.signature.flip())
        super().__init__(members)

    @property
    def table(self) -> RecordTable:
        """What is known of each dot."""
        return self.dots.dots.table

    @property
    def followed(self) -> int:
        """Clocks from the darkness of a frame's last pixels to its last dot."""
        return self.dots.latency

    @property
    def latency(self) -> int:
        return self.dots.latency + self.weighted.latency

    @property
    def interval(self) -> int:
        return max(self.dots.interval, self.weighted.interval)

    @property
    def multipliers(self) -> int:
        return self.weighted.multipliers

    def elaborate(self, platform):
        m = Module()
        m.submodules.dots = dots = self.dots
        m.submodules.weighted = weighted = self.weighted
        m.submodules.sum = total = self.sum
        found = dots.o
        if self.wants_shifts:
            m.submodules.fork = fork = Fork(dots.o.payload.shape(), 2)
            connect(m, dots.o, fork.i)
            connect(m, fork.o[1], wiring.flipped(self.shifts))
            found = fork.o[0]
        (shift,) = weighted.i.payload
        m.d.comb += [
            shift[0].eq(found.payload.u),
            shift[1].eq(found.payload.v),
            weighted.i.valid.eq(found.valid),
            found.ready.eq(weighted.i.ready),
            self.lost.eq(~dots.o.payload.seen),
            self.taken.eq(dots.o.valid & dots.o.ready),
        ]
        connect(m, wiring.flipped(self.darkness), dots.i)
        connect(m, wiring.flipped(self.skin), total.skin)
        connect(m, weighted.o, total.dots)
        connect(m, total.o, wiring.flipped(self.o))
        if self.loadable:
            connect(m, wiring.flipped(self.write), dots.write)
        return m
