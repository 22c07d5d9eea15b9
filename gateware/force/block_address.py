# amaranth: UnusedElaboratable=no
"""Addresses of a table with a word for each square of pixels, which all beats in the square read."""

from amaranth import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.force import WeightedSum


class BlockAddress(wiring.Component):
    """The word that each beat of a raster-scan frame uses, in a table with a row of words for each row of
    squares.

    Parameters: `rows`, of `beats` each, of a frame; `side`, rows of a square, and `width`, beats in a row
    that use the same word, powers of two; `cut_rows`, rows that the uppermost squares lack. The last squares
    of a row, and the lowest ones, are cut where the frame ends.

    Members
    -------
    take : a beat uses the word at `address`; the next one follows a clock later
    address : counts from 0, `words` are there
    ends_row : the beat is the last one of its row
    last : it is the frame's last one; the next one is the first of the next frame
    """

    def __init__(self, *, rows: int, beats: int, side: int, width: int, cut_rows: int = 0):
        for name, value in (("side", side), ("width", width)):
            if value < 1 or value & (value - 1):
                raise ValueError(f"{name}: {value}: expected a power of two")
        if not 0 <= cut_rows < side:
            raise ValueError(f"cut_rows: {cut_rows}: expected 0 to {side - 1}")
        self.rows, self.beats, self.side, self.width, self.cut_rows = rows, beats, side, width, cut_rows
        super().__init__(
            {"take": In(1), "address": Out(range(max(self.words, 2))), "ends_row": Out(1), "last": Out(1)}
        )

    @classmethod
    def of(cls, weighted: WeightedSum, lanes: int) -> "BlockAddress":
        """For the squares of a sum that takes `lanes` pixels a beat."""
        _, rows, columns, _ = weighted.weight.shape
        return cls(
            rows=rows,
            beats=-(-columns // lanes),
            side=weighted.block_px,
            width=max(weighted.block_px // lanes, 1),
            cut_rows=weighted.cut_rows,
        )

    @property
    def row_words(self) -> int:
        return -(-self.beats // self.width)

    @property
    def words(self) -> int:
        return -(-(self.rows + self.cut_rows) // self.side) * self.row_words

    def elaborate(self, platform):
        m = Module()
        row = Signal(range(self.cut_rows + self.rows), init=self.cut_rows)
        beat = Signal(range(max(self.beats, 2)))
        row_start = Signal.like(self.address)
        ends_row, ends_square, ends_word = self.ends_row, Signal(), Signal()
        m.d.comb += [
            ends_row.eq(beat == self.beats - 1),
            ends_square.eq((row & (self.side - 1)) == self.side - 1),
            ends_word.eq((beat & (self.width - 1)) == self.width - 1),
            self.last.eq(ends_row & (row == self.cut_rows + self.rows - 1)),
        ]
        with m.If(self.take):
            m.d.sync += beat.eq(Mux(ends_row, 0, beat + 1))
            with m.If(self.last):
                m.d.sync += [row.eq(self.cut_rows), self.address.eq(0), row_start.eq(0)]
            with m.Elif(ends_row):
                m.d.sync += row.eq(row + 1)
                with m.If(ends_square):
                    m.d.sync += [self.address.eq(self.address + 1), row_start.eq(self.address + 1)]
                with m.Else():
                    m.d.sync += self.address.eq(row_start)
            with m.Elif(ends_word):
                m.d.sync += self.address.eq(self.address + 1)
        return m
