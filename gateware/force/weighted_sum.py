"""Force as a weighted sum over the frame: one weight per displacement or slope and axis, accumulated."""

import numpy as np
from amaranth import Cat, Module, Mux, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import FrameAccumulator, beats_per_frame, dsp_slices, tree_levels
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
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
        With `by_sign` a pixel has one value, and the two terms are its positive and its negative part: its
        sign chooses the weight, so that one product does for both.
    o : stream of one beat per frame: one accumulator per axis, signed(weighted.width)
    constant : replaces `weighted.constant`; constant while a frame is in flight. Only with `loadable`.

    `latency` = 6 + ceil(log2(lanes·values)) clocks from a frame's last beat to its force, without
    back-pressure: 2 for the ROM of the weights, 3 for the products, an adder tree over lanes and a pixel's
    values, 1 for the accumulator. Initiation interval: `interval` = rows · ceil(columns/lanes) clocks per
    frame, without gaps. A force that is not taken stalls the whole pipeline before it.
    """

    def __init__(self, weighted: WeightedSum, *, lanes: int, loadable: bool = False, by_sign: bool = False):
        check_lanes(lanes)
        self.weighted, self.lanes, self.loadable = weighted, lanes, loadable
        self.by_sign = by_sign
        self.axes, self.rows, self.columns, self.terms = weighted.weight.shape
        if by_sign and (self.terms != 2 or not weighted.input_signed):
            raise ValueError(
                f"{self.terms} terms, signed {weighted.input_signed}: expected 2 of signed values"
            )
        self.values = 1 if by_sign else self.terms
        if self.interval < 2:
            raise ValueError(f"frame of {self.rows}×{self.columns}: expected at least 2 beats")
        pixel = Shape(weighted.input_width, weighted.input_signed)
        if self.values > 1:
            pixel = data.ArrayLayout(pixel, self.values)
        sums = data.ArrayLayout(signed(weighted.width), self.axes)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
            "o": Out(stream.Signature(sums)),
        }
        if loadable:
            members["constant"] = In(sums)
        super().__init__(members)

    @staticmethod
    def latency_of(values: int, lanes: int) -> int:
        return RasterRom.latency + PRODUCT_LATENCY + tree_levels(lanes * values) + 1

    @staticmethod
    def multipliers_of(axes: int, values: int, lanes: int, *, input_bits: int, weight_bits: int) -> int:
        """DSP48E2 slices: axes · lanes · values products of `dsp_slices(…)` slices each."""
        return axes * lanes * values * dsp_slices(input_bits, weight_bits)

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
        )

    def elaborate(self, platform):
        m = Module()
        words = weight_words(self.weighted, self.lanes)
        bounds = np.abs(words) * self.weighted.input_limit
        if self.by_sign:
            bounds = bounds.reshape(*bounds.shape[:2], self.lanes, self.terms).max(axis=-1)
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
        pixels = [[lane] if self.values == 1 else list(lane) for lane in inputs]
        for axis, weight in enumerate(weights.word):
            for k, x in enumerate(x for pixel in pixels for x in pixel):
                factor = Mux(x < 0, weight[2 * k + 1], weight[2 * k]) if self.by_sign else weight[k]
                whole = product(m, platform, advance, x, factor, name=f"product_{axis}_{k}")
                width = signed_width(int(bounds[:, axis, k].max()))
                m.d.comb += products.payload[axis][k].eq(whole[:width].as_signed())
        return m
