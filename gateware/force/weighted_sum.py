# amaranth: UnusedElaboratable=no
"""Force as a weighted sum over the frame of displacements or slopes, or of lines that bend in them."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.frame_sum import FrameAccumulator, beats_per_frame, tree_levels
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
from fastac.gateware.force.bent_product import bent_product
from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.weight_rom import WeightRom
from fastac.gateware.force.weighted_pixel import WeightedPixel
from fastac.gateware.stream.handshake import check_lanes
from fastac.gateware.stream.tables import RasterRom, raster_beats
from fastac.models.integer.force import WeightedSum
from fastac.models.integer.force_segments import largest, segment_slopes
from fastac.models.integer.words import signed_width


def rom_table(weighted: WeightedSum, bends: tuple[int, ...]) -> np.ndarray:
    """What the ROM of `WeightedSumStream` holds, (axes, rows, columns, terms), of each square of
    `weighted.block_px`: the weights or, with bends, the slopes of their segments."""
    weight = weighted.block_weight
    return segment_slopes(weight) if bends else weight


def rom_width(weighted: WeightedSum, bends: tuple[int, ...]) -> int:
    """Bits of a value in that ROM."""
    return signed_width(int(np.abs(rom_table(weighted, bends)).max()))


def beat_words(table: np.ndarray, lanes: int) -> np.ndarray:
    """A table (axes, rows, columns, values) in beat order: (rows · ceil(columns/lanes), axes, lanes, values);
    0 in unused lanes."""
    return raster_beats(np.moveaxis(table, 0, 2), lanes).swapaxes(1, 2)


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
    values, 1 for the accumulator. `values` = terms, but 1 with `bends`: between them the terms' sum is a
    straight line, so that a pixel takes one product with its segment's slope, which the ROM holds in place of
    the weights; of a square of pixels with the same weights (`weighted.block_px`) it holds one word.
    Initiation interval: `interval` = rows · ceil(columns/lanes) clocks per frame, without gaps.
    A force that is not taken stalls the whole pipeline before it.
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
        self.values = 1 if bends else self.terms
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
            weight_bits=rom_width(weighted, self.bends),
            dsp=self.dsp,
        )

    def elaborate(self, platform):
        m = Module()
        weights, factors = self._weights()
        if self.bends:
            reached = largest(self.weighted.weight, self.bends, self.weighted.input_limit)[..., None]
        else:
            reached = np.abs(self.weighted.weight) * self.weighted.input_limit
        bounds = beat_words(reached, self.lanes).reshape(self.interval, self.axes, -1)
        m.submodules.weights = weights
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
        if self.weighted.block_px > 1:
            inputs = self._inside(m, weights.squares.ends_row)
        for stage in range(RasterRom.latency):
            delayed = Signal(inputs.shape(), reset_less=True, name=f"inputs_{stage}")
            with m.If(advance):
                m.d.sync += delayed.eq(inputs)
            inputs = delayed
        for axis, of_axis in enumerate(factors):
            for k, bound in enumerate(bounds[:, axis].max(axis=0)):
                lane, value = divmod(k, self.values)
                pixel, factor, name = inputs[lane], of_axis[lane], f"product_{axis}_{k}"
                if self.bends:
                    whole = bent_product(
                        m, platform, advance, pixel, factor, self.bends, bound=int(bound), name=name
                    )
                else:
                    x = pixel if self.terms == 1 else pixel[value]
                    whole = product(m, platform, advance, x, factor[value], name=name)
                width = signed_width(int(bound))
                m.d.comb += products.payload[axis][k].eq(whole[:width].as_signed())
        return m

    def _inside(self, m: Module, ends_row: Signal) -> Signal:
        """The pixels of a beat, 0 in lanes beyond the row: the weights there are those of the last square."""
        inside = Signal(self.i.payload.shape())
        last = (self.columns - 1) % self.lanes
        for lane in range(self.lanes):
            given = Value.cast(self.i.payload[lane])
            m.d.comb += Value.cast(inside[lane]).eq(Mux(ends_row, 0, given) if lane > last else given)
        return inside

    def _weights(self) -> tuple[RasterRom | WeightRom, list[list[list]]]:
        """The ROM, and of its word the values by axis and lane."""
        table, side = rom_table(self.weighted, self.bends), self.weighted.block_px
        if side == 1:
            words = beat_words(table, self.lanes)
            rom = RasterRom(words, rom_width(self.weighted, self.bends))
            return rom, [[list(of_lane) for of_lane in of_axis] for of_axis in rom.word]
        words = beat_words(table, max(self.lanes // side, 1))
        rom = WeightRom(words.reshape(len(words), -1), BlockAddress.of(self.weighted, self.lanes))
        places = np.arange(words[0].size).reshape(words[0].shape)
        of_lanes = places[:, np.arange(self.lanes) // side]
        return rom, [[[rom.word[k] for k in of_lane] for of_lane in of_axis] for of_axis in of_lanes.tolist()]
