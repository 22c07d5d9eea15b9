"""From displacements or slopes to the raw force accumulators A of a frame: one weight a value, summed."""

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
    """The weights in the order of the beats: (rows · ceil(columns/lanes), axes, lanes · terms).

    Void lanes are zero.
    """
    beats = raster_beats(np.moveaxis(weighted.weight, 0, 2), lanes)  # (beats, lanes, axes, terms)
    return beats.swapaxes(1, 2).reshape(len(beats), len(weighted.weight), -1)


class WeightedSumStream(wiring.Component):
    """Whole frames of words to A = constant + Σ weight · x, bit for bit `weighted(x)`.

    Members
    -------
    i : stream of `lanes` pixels, each one word, or an array of `terms` where there are several, of
        Shape(weighted.input_width, weighted.input_signed); `rows` of ceil(columns/lanes) beats make a frame,
        lanes beyond `columns` are void. A signed word is never the lowest of its format.
    o : stream of one beat a frame, an accumulator signed(weighted.width) per axis
    constant : in place of the weighted sum's own, still while a frame is inside. Only with `loadable`.

    From the last beat of a frame to its force pass, if nothing stalls, `latency` =
    6 + ceil(log2(lanes·terms)) clocks: 2 of the weights' ROM, 3 of the products, a tree over lanes and terms,
    and the accumulator. The next frame may follow without a gap: one begins every `interval` =
    rows · ceil(columns/lanes) clocks. Until a force is taken everything behind it waits.
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
        """DSP48E2: axes · lanes · terms, times `dsp_slices` of a weight and an input as signed words."""
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
