# amaranth: UnusedElaboratable=no
"""Force as a weighted sum over a frame that comes slowly: a few multipliers, one adder for all axes."""

import numpy as np
from amaranth import Module, Mux
from amaranth.lib import wiring

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.shared_accumulator import SharedAccumulator
from fastac.gateware.force.shared_products import (
    SharedProducts,
    products_latency,
    shared_multipliers,
)
from fastac.gateware.force.weighted_pixel import WeightedPixel
from fastac.gateware.stream.handshake import check_folded
from fastac.models.integer.force import WeightedSum


def products_of(bends: int) -> int:
    """How many products an axis takes of a displacement with so many bends: one for itself and one for each
    bend, as of what is beyond the band on either side one is 0."""
    return 1 + bends


class FoldedWeightedSum(wiring.Component):
    """Sum a frame with weights, A = constant + Σ weight · x, as `weighted(x)` does, a pixel in `fold` clocks.

    Members
    -------
    i : stream of one pixel per beat, a value, or an array of `terms` values if there are several, of
        Shape(weighted.input_width, weighted.input_signed). A frame is rows · columns beats. A signed value
        must not be the most negative word. With `bends` a pixel has one value, and its terms follow from it
        as `integer.force.terms` says. After a beat `ready` is low for fold − 1 clocks.
    o : stream of one beat per frame: one accumulator per axis, signed(weighted.width)
    constant : replaces `weighted.constant`; constant while a frame is in flight. Only with `loadable`.

    `latency` = 6 + ceil(log2(multipliers)) + slots − 1 clocks from a frame's last beat to its force, without
    back-pressure: that of `WeightedSumStream` for the values that are multiplied at once, and one clock for
    each slot before a pixel's last (`shares_of` says which products are found in which slot). Initiation
    interval: `interval` = fold · rows · columns clocks per frame. A force that is not taken stalls the
    whole pipeline before it.
    """

    def __init__(
        self,
        weighted: WeightedSum,
        *,
        fold: int,
        loadable: bool = False,
        bends: tuple[int, ...] = (),
        dsp: DspSlice = DSP48E2,
    ):
        check_folded(fold)
        self.weighted, self.fold, self.loadable = weighted, fold, loadable
        self.bends, self.dsp = bends, dsp
        self.axes, self.rows, self.columns, self.terms = weighted.weight.shape
        self.pixel = WeightedPixel(weighted, bends)
        self.values = products_of(len(bends)) if bends else self.terms
        if self.rows * self.columns < 2:
            raise ValueError(f"frame of {self.rows}×{self.columns}: expected at least 2 pixels")
        super().__init__(self.pixel.members(1, loadable=loadable))

    @staticmethod
    def latency_of(axes: int, values: int, fold: int) -> int:
        return products_latency(axes, values, fold) + SharedAccumulator.latency

    @staticmethod
    def multipliers_of(
        axes: int, values: int, fold: int, *, input_bits: int, weight_bits: int, dsp: DspSlice
    ) -> int:
        """DSP slices: ceil(axes · values/fold) products of `dsp.slices(…)` slices each, see `shares_of`."""
        return shared_multipliers(axes, values, fold, input_bits=input_bits, weight_bits=weight_bits, dsp=dsp)

    @property
    def latency(self) -> int:
        return self.latency_of(self.axes, self.values, self.fold)

    @property
    def interval(self) -> int:
        return self.fold * self.rows * self.columns

    @property
    def multipliers(self) -> int:
        weighted = self.weighted
        return self.multipliers_of(
            self.axes,
            self.values,
            self.fold,
            input_bits=weighted.input_width + (not weighted.input_signed),
            weight_bits=weighted.weight_width,
            dsp=self.dsp,
        )

    def elaborate(self, platform):
        m = Module()
        weighted = self.weighted
        m.submodules.products = products = SharedProducts(
            np.moveaxis(weighted.block_weight, 0, 2).reshape(-1, self.axes, self.terms),
            self._terms(),
            shape=self.pixel.value,
            limit=weighted.input_limit,
            fold=self.fold,
            squares=BlockAddress.of(weighted, 1) if weighted.block_px > 1 else None,
        )
        parts = products.latency + SharedAccumulator.latency
        assert parts == self.latency, f"latency {parts}: stated {self.latency}"

        pixel, given = self.i.payload[0], products.i.payload
        m.d.comb += [
            products.i.valid.eq(self.i.valid),
            self.i.ready.eq(products.i.ready),
            products.advance.eq(self.o.ready | ~self.o.valid),
        ]
        m.d.comb += [given[k].eq(value) for k, value in enumerate(self._values(pixel))]
        if self.bends:
            m.d.comb += products.second.eq(pixel < 0)

        longest = max(products.shares, key=lambda share: share.slots)
        for share, width, part in zip(products.shares, products.widths, products.parts, strict=True):
            of_share = slice(share.first, share.first + share.axes)
            accumulator = SharedAccumulator(
                share.axes,
                width=weighted.width,
                term_width=width,
                start=weighted.constant[of_share],
                loadable=self.loadable,
            )
            m.submodules[f"accumulator_{share.first}"] = accumulator
            m.d.comb += [
                accumulator.advance.eq(products.advance),
                accumulator.term.eq(part.sum),
                accumulator.valid.eq(part.valid),
                accumulator.ends.eq(part.ends_frame),
            ]
            for k, axis in enumerate(range(share.first, share.first + share.axes)):
                m.d.comb += self.o.payload[axis].eq(accumulator.sums[k])
                if self.loadable:
                    m.d.comb += accumulator.start[k].eq(self.constant[axis])
            if share is longest:
                m.d.comb += self.o.valid.eq(accumulator.done)
        return m

    def _values(self, pixel) -> list:
        """What is multiplied of a pixel."""
        if self.bends:
            band, *deep = self.bends
            beyond = Mux(pixel > band, pixel - band, Mux(pixel < -band, pixel + band, 0))
            return [pixel, beyond, *(Mux(pixel > bend, pixel - bend, 0) for bend in deep)]
        return [pixel] if self.terms == 1 else list(pixel)

    def _terms(self) -> list[tuple[int, ...]]:
        """Of each value the terms whose weights it has: beyond the band the one of its side."""
        if self.bends:
            return [(0,), (1, 2), *((k,) for k in range(3, self.terms))]
        return [(k,) for k in range(self.terms)]
