"""Force as a weighted sum over the frame: one weight per displacement or slope and axis, accumulated."""

import numpy as np
from amaranth import Cat, Module, Shape, Signal, signed
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
    o : stream of one beat per frame: one accumulator per axis, signed(weighted.width)
    constant : replaces `weighted.constant`; constant while a frame is in flight. Only with `loadable`.

    `latency` = 6 + ceil(log2(lanes·terms)) clocks from a frame's last beat to its force, without
    back-pressure: 2 for the ROM of the weights, 3 for the products, an adder tree over lanes and terms, 1 for
    the accumulator. Initiation interval: `interval` = rows · ceil(columns/lanes) clocks per frame, without
    gaps. A force that is not taken stalls the whole pipeline before it.
    """

    def __init__(self, weighted: WeightedSum, *, lanes: int, loadable: bool = False):
        check_lanes(lanes)
        self.weighted, self.lanes, self.loadable = weighted, lanes, loadable
        self.axes, self.rows, self.columns, self.terms = weighted.weight.shape
        if self.interval < 2:
            raise ValueError(f"frame of {self.rows}×{self.columns}: expected at least 2 beats")
        pixel = Shape(weighted.input_width, weighted.input_signed)
        if self.terms > 1:
            pixel = data.ArrayLayout(pixel, self.terms)
        sums = data.ArrayLayout(signed(weighted.width), self.axes)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
            "o": Out(stream.Signature(sums)),
        }
        if loadable:
            members["constant"] = In(sums)
        super().__init__(members)

    @staticmethod
    def latency_of(terms: int, lanes: int) -> int:
        return RasterRom.latency + PRODUCT_LATENCY + tree_levels(lanes * terms) + 1

    @staticmethod
    def multipliers_of(axes: int, terms: int, lanes: int, *, input_bits: int, weight_bits: int) -> int:
        """DSP48E2 slices: axes · lanes · terms products of `dsp_slices(…)` slices each."""
        return axes * lanes * terms * dsp_slices(input_bits, weight_bits)

    @property
    def latency(self) -> int:
        return self.latency_of(self.terms, self.lanes)

    @property
    def interval(self) -> int:
        return beats_per_frame(self.rows, self.columns, self.lanes)

    @property
    def multipliers(self) -> int:
        weighted = self.weighted
        return self.multipliers_of(
            self.axes,
            self.terms,
            self.lanes,
            input_bits=weighted.input_width + (not weighted.input_signed),
            weight_bits=weighted.weight_width,
        )

    def elaborate(self, platform):
        m = Module()
        words = weight_words(self.weighted, self.lanes)
        bounds = np.abs(words) * self.weighted.input_limit
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
        pixels = [[lane] if self.terms == 1 else list(lane) for lane in inputs]
        for axis, weight in enumerate(weights.word):
            for k, x in enumerate(x for pixel in pixels for x in pixel):
                whole = product(m, platform, advance, x, weight[k], name=f"product_{axis}_{k}")
                width = signed_width(int(bounds[:, axis, k].max()))
                m.d.comb += products.payload[axis][k].eq(whole[:width].as_signed())
        return m
