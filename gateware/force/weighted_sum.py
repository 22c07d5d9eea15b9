"""Force as a weighted sum over the frame: one weight per displacement or slope and axis, accumulated."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal
from amaranth.lib import wiring

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.frame_sum import FrameAccumulator, beats_per_frame, tree_levels
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
from fastac.gateware.force.weighted_pixel import WeightedPixel
from fastac.gateware.stream.handshake import check_lanes
from fastac.gateware.stream.tables import RasterRom, raster_beats
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.words import signed_width


def weight_words(weighted: WeightedSum, lanes: int) -> np.ndarray:
    """The weights in beat order: (rows · ceil(columns/lanes), axes, lanes · terms); 0 in unused lanes."""
    beats = raster_beats(np.moveaxis(weighted.weight, 0, 2), lanes)  # (beats, lanes, axes, terms)
    return beats.swapaxes(1, 2).reshape(len(beats), len(weighted.weight), -1)


class WeightedSumStream(wiring.Component):
    """Sum a frame with weights, A = constant + Σ weight · x, bit-exact to `weighted(x)`.

    Members
    -------
    i : stream of `lanes` pixels, each a value, or an array of `terms` values if there are several, of
        Shape(weighted.input_width, weighted.input_signed). A frame is `rows` rows of ceil(columns/lanes)
        beats; the lanes beyond `columns` are ignored. A signed value must not be the most negative word.
        With `bends` a pixel has one value, and its terms follow from it as `integer.force.terms` says.
    o : stream of one beat per frame: one accumulator per axis, signed(weighted.width)
    constant : replaces `weighted.constant`; constant while a frame is in flight. Only with `loadable`.

    `latency` = 6 + ceil(log2(lanes·values)) clocks from a frame's last beat to its force, without
    back-pressure: 2 for the ROM of the weights, 3 for the products, an adder tree over lanes and a pixel's
    values, 1 for the accumulator. `values` = terms, but with `bends` those of `products_of`: of what is
    beyond the band on either side one is 0, so that its sign chooses the weight of a single product.
    Initiation interval: `interval` = rows · ceil(columns/lanes) clocks per frame, without gaps. A force that
    is not taken stalls the whole pipeline before it.
    """

    def __init__(
        self,
        weighted: WeightedSum,
        *,
        lanes: int,
        loadable: bool = False,
        bends: tuple[int, ...] = (),
        dsp: DspSlice = DSP48E2,
    ):
        check_lanes(lanes)
        self.weighted, self.lanes, self.loadable = weighted, lanes, loadable
        self.bends, self.dsp = bends, dsp
        self.axes, self.rows, self.columns, self.terms = weighted.weight.shape
        self.pixel = WeightedPixel(weighted, bends)
        self.values = self.pixel.products
        if self.interval < 2:
            raise ValueError(f"frame of {self.rows}×{self.columns}: expected at least 2 beats")
        super().__init__(self.pixel.members(lanes, loadable=loadable))

    @staticmethod
    def latency_of(values: int, lanes: int) -> int:
        return RasterRom.latency + PRODUCT_LATENCY + tree_levels(lanes * values) + 1

    @staticmethod
    def multipliers_of(
        axes: int, values: int, lanes: int, *, input_bits: int, weight_bits: int, dsp: DspSlice
    ) -> int:
        """DSP slices: axes · lanes · values products of `dsp.slices(…)` slices each."""
        return axes * lanes * values * dsp.slices(input_bits, weight_bits)

    @property
    def latency(self) -> int:
        return self.latency_of(self.values, self.lanes)

    @property
    def interval(self) -> int:
        return beats_per_frame(self.rows, self.columns, self.lanes)

    @property
    def multipliers(self) -> int:
        weighted = self.weighted
        return self.multipliers_of(
            self.axes,
            self.values,
            self.lanes,
            input_bits=weighted.input_width + (not weighted.input_signed),
            weight_bits=weighted.weight_width,
            dsp=self.dsp,
        )

    def elaborate(self, platform):
        m = Module()
        words = weight_words(self.weighted, self.lanes)
        bounds = np.abs(words) * self.weighted.input_limit
        if self.bends:
            each = bounds.reshape(*bounds.shape[:2], self.lanes, self.terms)
            either = each[..., 1:3].max(axis=-1, keepdims=True)
            each = np.concatenate([each[..., :1], either, each[..., 3:]], axis=-1)
            bounds = each.reshape(*bounds.shape[:2], -1)
        m.submodules.weights = weights = RasterRom(words, self.weighted.weight_width)
        m.submodules.accumulator = accumulator = FrameAccumulator(
            bounds, self.weighted.constant, loadable=self.loadable, width=self.weighted.width
        )
        if self.loadable:
            m.d.comb += accumulator.start.eq(self.constant)
        valid = Signal(RasterRom.latency + PRODUCT_LATENCY)
        parts = len(valid) + accumulator.latency
        assert parts == self.latency, f"latency {parts}: stated {self.latency}"
        assert accumulator.interval == self.interval

        products, advance = accumulator.i, Signal()
        m.d.comb += [
            advance.eq(products.ready | ~products.valid),
            self.i.ready.eq(advance),
            products.valid.eq(valid[-1]),
            weights.advance.eq(advance),
            weights.take.eq(self.i.valid),
        ]
        with m.If(advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))
        wiring.connect(m, accumulator.o, wiring.flipped(self.o))

        inputs = self.i.payload
        for stage in range(RasterRom.latency):
            delayed = Signal(inputs.shape(), reset_less=True, name=f"inputs_{stage}")
            with m.If(advance):
                m.d.sync += delayed.eq(inputs)
            inputs = delayed
        values = [self.pixel.values(lane) for lane in inputs]
        for axis, weight in enumerate(weights.word):
            for k, (x, factor) in enumerate(self._factors(values, weight)):
                whole = product(m, platform, advance, x, factor, name=f"product_{axis}_{k}")
                width = signed_width(int(bounds[:, axis, k].max()))
                m.d.comb += products.payload[axis][k].eq(whole[:width].as_signed())
        return m

    def _factors(self, values: list, weight):
        """Each value of the lanes with its weight."""
        for lane, of_lane in enumerate(values):
            if not self.bends:
                yield from ((x, weight[lane * self.terms + k]) for k, x in enumerate(of_lane))
                continue
            whole, beyond, *deep = of_lane
            inside, towards, away, *of_deep = (weight[lane * self.terms + k] for k in range(self.terms))
            yield whole, inside
            yield beyond, Mux(whole < 0, away, towards)
            yield from zip(deep, of_deep, strict=True)
