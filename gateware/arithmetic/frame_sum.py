"""Sum all values of a frame: adder tree over the words of a beat, then an accumulator; widths from bounds."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.words import signed_width


def tree_levels(terms: int) -> int:
    """Latency of `adder_tree` in clocks, one register per level: ceil(log2(terms))."""
    return (terms - 1).bit_length()


def adder_tree(m: Module, advance, terms: list, bounds: np.ndarray, name: str):
    """Build a tree of two-operand adders over `terms`, a register per level, in `m`; returns the sum.

    advance : clock enable of the registers
    bounds : (cases, terms), the largest magnitude of each term in each case, here for each word of a ROM
    name : prefix of the registers' names

    Each node has just the bits for the largest sum of its terms' bounds over all cases.
    Latency: `tree_levels(len(terms))` clocks.
    """
    for level in range(tree_levels(len(terms))):
        pairs = [terms[k : k + 2] for k in range(0, len(terms), 2)]
        bounds = np.add.reduceat(bounds, np.arange(0, len(terms), 2), axis=1)
        terms = [
            Signal(signed(signed_width(int(bound))), reset_less=True, name=f"{name}_sum{level}_{k}")
            for k, bound in enumerate(bounds.max(axis=0))
        ]
        with m.If(advance):
            m.d.sync += [s.eq(sum(pair[1:], pair[0])) for s, pair in zip(terms, pairs, strict=True)]
    return terms[0]


def beats_per_frame(rows: int, columns: int, lanes: int) -> int:
    """Beats of a raster frame whose every row starts with a new beat: rows · ceil(columns/lanes)."""
    return rows * -(-columns // lanes)


class FrameAccumulator(wiring.Component):
    """Sum all words of a frame for each axis: A = constant + Σ words.

    Parameters: `bounds` (beats, axes, words), the largest magnitude of each word in each beat of a frame;
    `constant` (axes,), the initial value of each sum; `width`, the bits of a sum, by default the least that
    hold ±(|constant| + Σ bounds) of the worst axis, hence every partial sum too.

    Members
    -------
    i : stream of axes × words, signed(`word_width`) each, `word_width` = signed_width(max(bounds)); `beats`
        of them make a frame
    o : stream of one beat per frame: one sum per axis, signed(`width`)
    start : replaces `constant`: signed(`width`) per axis, small enough that no sum overflows. Only with
        `loadable`.

    `latency` = ceil(log2(words)) + 1 clocks (adder tree, accumulator) from a frame's last beat to its sums,
    without back-pressure. Initiation interval: `interval` = beats clocks per frame, without gaps. The
    accumulator is also the output register: until the sums are taken, the whole pipeline is stalled.
    """

    def __init__(
        self, bounds: np.ndarray, constant: np.ndarray, *, loadable: bool = False, width: int | None = None
    ):
        self.bounds, self.constant, self.loadable = bounds, constant, loadable
        largest = int((np.abs(constant) + bounds.sum(axis=(0, 2))).max())
        self.width = signed_width(largest) if width is None else width
        if self.width < signed_width(largest):
            raise ValueError(f"width {width}: expected {signed_width(largest)} for sums of ±{largest}")
        self.interval, self.axes, self.words = bounds.shape
        words = data.ArrayLayout(signed(self.word_width), self.words)
        sums = data.ArrayLayout(signed(self.width), self.axes)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(words, self.axes))),
            "o": Out(stream.Signature(sums)),
        }
        if loadable:
            members["start"] = In(sums)
        super().__init__(members)

    @property
    def word_width(self) -> int:
        return signed_width(int(self.bounds.max()))

    @property
    def latency(self) -> int:
        return tree_levels(self.words) + 1

    def elaborate(self, platform):
        m = Module()
        advance = Signal()
        done = Signal()
        valid = Signal(tree_levels(self.words))
        summed = Cat(self.i.valid, valid)[-1]  # a beat's sum is at the accumulator's input
        m.d.comb += [
            advance.eq(self.o.ready | ~done),
            self.i.ready.eq(advance),
            self.o.valid.eq(done),
        ]

        beat = Signal(range(self.interval))
        fresh = Signal(init=1)  # the next beat is the first of a frame
        last = beat == self.interval - 1
        with m.If(advance):
            m.d.sync += [valid.eq(Cat(self.i.valid, valid)), done.eq(summed & last)]
            with m.If(summed):
                m.d.sync += [beat.eq(Mux(last, 0, beat + 1)), fresh.eq(last)]

        for axis, words in enumerate(self.i.payload):
            total = adder_tree(m, advance, list(words), self.bounds[:, axis], f"axis_{axis}")
            accumulator = Signal(signed(self.width), reset_less=True, name=f"accumulator_{axis}")
            start = self.start[axis] if self.loadable else int(self.constant[axis])
            with m.If(advance & summed):
                m.d.sync += accumulator.eq(Mux(fresh, start, accumulator) + total)
            m.d.comb += self.o.payload[axis].eq(accumulator)
        return m
