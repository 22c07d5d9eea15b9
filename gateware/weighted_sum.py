"""From displacements or slopes to the raw force accumulators A of a frame: one weight a value, summed."""

import numpy as np
from amaranth import Cat, Module, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.fixed import signed_width
from models.integer import WeightedSum

from .displacement import LANES, RasterRom, raster_beats
from .frame_accumulator import FrameAccumulator, dsp_slices, tree_levels


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

    From the last beat of a frame to its force pass, if nothing stalls, `latency` =
    5 + ceil(log2(lanes·terms)) clocks: 2 of the weights' ROM, operands (A, B), product (M), a tree over lanes
    and terms, whose first sum is a slice's P, and the accumulator. The next frame may follow without a gap:
    one begins every `interval` = rows · ceil(columns/lanes) clocks. Until a force is taken everything behind
    it waits.
    """

    def __init__(self, weighted: WeightedSum, *, lanes: int):
        if lanes not in LANES:
            raise ValueError(f"lanes {lanes}: expected one of {LANES}")
        self.weighted, self.lanes = weighted, lanes
        self.axes, self.rows, self.columns, self.terms = weighted.weight.shape
        if self.interval < 2:
            raise ValueError(f"frame of {self.rows}×{self.columns}: expected at least 2 beats")
        pixel = Shape(weighted.input_width, weighted.input_signed)
        if self.terms > 1:
            pixel = data.ArrayLayout(pixel, self.terms)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(pixel, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(signed(weighted.width), self.axes))),
            }
        )

    @property
    def latency(self) -> int:
        return RasterRom.latency + 3 + tree_levels(self.lanes * self.terms)

    @property
    def interval(self) -> int:
        return self.rows * -(-self.columns // self.lanes)

    @property
    def multipliers(self) -> int:
        """DSP48E2: axes · lanes · terms, times `dsp_slices` of a weight and an input as signed words."""
        weighted = self.weighted
        input_width = weighted.input_width + (not weighted.input_signed)
        return self.axes * self.lanes * self.terms * dsp_slices(input_width, weighted.weight_width)

    def elaborate(self, platform):
        m = Module()
        words = weight_words(self.weighted, self.lanes)
        bounds = np.abs(words) * self.weighted.input_limit
        m.submodules.weights = weights = RasterRom(words, self.weighted.weight_width)
        m.submodules.accumulator = accumulator = FrameAccumulator(bounds, self.weighted.constant)
        valid = Signal(RasterRom.latency + 2)
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

        def register(value, name: str) -> Signal:
            """`value` one advance later; data has no reset."""
            signal = Signal(value.shape(), reset_less=True, name=name)
            with m.If(advance):
                m.d.sync += signal.eq(value)
            return signal

        inputs = self.i.payload
        for stage in range(RasterRom.latency):
            inputs = register(inputs, f"inputs_{stage}")
        pixels = [[lane] if self.terms == 1 else list(lane) for lane in inputs]
        operands = [register(x, f"x_{k}") for k, x in enumerate(x for pixel in pixels for x in pixel)]
        for axis, weight in enumerate(weights.word):
            for k, x in enumerate(operands):
                factor = register(weight[k], f"weight_{axis}_{k}")
                width = signed_width(int(bounds[:, axis, k].max()))
                product = Signal(signed(width), reset_less=True, name=f"product_{axis}_{k}")
                with m.If(advance):
                    m.d.sync += product.eq(factor * x)
                m.d.comb += products.payload[axis][k].eq(product)
        return m
