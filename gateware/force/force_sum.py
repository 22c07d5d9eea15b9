# amaranth: UnusedElaboratable=no
"""The force as the sum of its two parts, that of the skin and that of the marker dots."""

from amaranth import Module, Signal, Value, signed
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer.dot_force import DotForce


class ForceSum(wiring.Component):
    """Add the dots' sums of a frame, in the skin's units, to the skin's.

    Members
    -------
    skin : stream of one beat per frame, an accumulator per axis, signed(skin_width)
    dots : the same of the dots, signed(dot_force.weighted.width)
    o : the same of both, signed(width)

    Either part may come first, by as many frames as the datapath holds: queues keep it, so that neither part
    has to wait. `latency` = 2 clocks from the later part to the sum: queue and register.
    """

    latency = 2

    def __init__(self, dot_force: DotForce, *, skin_width: int, width: int):
        self.dot_force = dot_force
        axes, of_dots = len(dot_force.exponent), dot_force.weighted.width

        def sums(bits: int) -> stream.Signature:
            return stream.Signature(data.ArrayLayout(signed(bits), axes))

        super().__init__({"skin": In(sums(skin_width)), "dots": In(sums(of_dots)), "o": Out(sums(width))})

    def elaborate(self, platform):
        m = Module()
        parts, ready = {}, Signal()
        for name in ("skin", "dots"):
            source = getattr(self, name)
            layout = source.payload.shape()
            m.submodules[f"{name}_queue"] = queue = fifo.SyncFIFO(
                width=len(Value.cast(source.payload)), depth=FRAMES_IN_FLIGHT
            )
            m.d.comb += [
                queue.w_data.eq(source.payload),
                queue.w_en.eq(source.valid),
                source.ready.eq(queue.w_rdy),
                queue.r_en.eq(ready),
            ]
            parts[name] = data.View(layout, queue.r_data), queue.r_rdy
        (skin, skin_here), (dots, dots_here) = parts["skin"], parts["dots"]
        m.d.comb += ready.eq(skin_here & dots_here & (self.o.ready | ~self.o.valid))
        with m.If(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        with m.If(ready):
            m.d.sync += self.o.valid.eq(1)
            for axis, exponent in enumerate(self.dot_force.exponent.tolist()):
                m.d.sync += self.o.payload[axis].eq(skin[axis] + dots[axis].shift_left(exponent))
        return m
