# amaranth: UnusedElaboratable=no
"""Slopes of the skin under its dots: dark pixels wait for their slopes, and are bridged."""

from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect

from fastac.gateware.dots.dark_queue import DarkQueue
from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.models.integer.slope_bridge import SlopeBridge


class BridgedSlopes(wiring.Component):
    """Bridge the slopes of pixels whose darkness came before, bit-exact to `bridge(slopes, darkness > 0)`.

    Members
    -------
    slopes : stream of `lanes` slopes (p, q), signed(slope_bits) each, rows of W pixels
    over : a bit for each slope of the beat that `slopes` offers: it saturated
    darkness : stream of the darkness of the same pixels, see `DarknessStream.o`; at most `ahead` beats of it
        are kept, so that it waits where it is farther ahead
    o : the bridged slopes, as `slopes`
    o_over : `over` of the slopes that were taken, for the beat that `o` offers
    saturated : high while a beat with a saturated slope is valid

    `latency` is that of `SlopeBridgeStream`, from a beat's slopes, with its darkness there before.
    """

    def __init__(self, bridge: SlopeBridge, *, slope_bits: int, lanes: int, ahead: int, fold: int = 1):
        self.queue = DarkQueue(bridge.windows, lanes=lanes, depth=ahead)
        self.bridge = SlopeBridgeStream(bridge, slope_bits=slope_bits, lanes=lanes, fold=fold)
        slopes = stream.Signature(self.bridge.o.payload.slopes.shape())
        super().__init__(
            {
                "slopes": In(slopes),
                "over": In(2 * lanes),
                "darkness": In(self.queue.i.signature.flip()),
                "o": Out(slopes),
                "o_over": Out(2 * lanes),
                "saturated": Out(1),
            }
        )

    @property
    def latency(self) -> int:
        return self.bridge.latency

    def elaborate(self, platform):
        m = Module()
        m.submodules.queue = queue = self.queue
        m.submodules.bridge = bridge = self.bridge
        connect(m, wiring.flipped(self.darkness), queue.i)
        m.d.comb += [
            bridge.i.payload.slopes.eq(self.slopes.payload),
            bridge.i.payload.over.as_value().eq(self.over),
            bridge.i.payload.dark.eq(queue.o.payload),
            bridge.i.valid.eq(self.slopes.valid & queue.o.valid),
            self.slopes.ready.eq(bridge.i.ready & queue.o.valid),
            queue.o.ready.eq(bridge.i.ready & self.slopes.valid),
            self.o.payload.eq(bridge.o.payload.slopes),
            self.o.valid.eq(bridge.o.valid),
            bridge.o.ready.eq(self.o.ready),
            self.o_over.eq(bridge.o.payload.over),
            self.saturated.eq(bridge.o.valid & self.o_over.any()),
        ]
        return m
