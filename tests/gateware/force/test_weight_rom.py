# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.weight_rom import WeightRom
from fastac.gateware.stream.handshake import pipeline_handshake
from fastac.sim.check_stream import check, pack


class Words(wiring.Component):
    """A word of the table, and whether it is the last one, for every beat."""

    def __init__(self, rom: WeightRom):
        self.rom = rom
        self.bits = len(rom.word.as_value()) + 1
        super().__init__({"i": In(stream.Signature(1)), "o": Out(stream.Signature(self.bits))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.rom = rom = self.rom
        last = rom.last
        advance = pipeline_handshake(m, self.i, self.o, WeightRom.latency)
        for stage in range(WeightRom.latency):
            later = Signal(name=f"last_{stage}")
            with m.If(advance):
                m.d.sync += later.eq(last)
            last = later
        m.d.comb += [
            rom.advance.eq(advance),
            rom.take.eq(self.i.valid),
            self.o.payload.eq(rom.word.as_value() | (last << (self.bits - 1))),
        ]
        return m


def test_words_of_squares_are_read_again(tmp_path):
    table = np.random.default_rng(2).integers(-64, 64, (21, 2))
    squares = BlockAddress(rows=25, beats=5, side=4, width=2, cut_rows=1)
    rom = WeightRom(table, squares)
    dut = Words(rom)
    first, *others = ([3 * k, 3 * k, 3 * k + 1, 3 * k + 1, 3 * k + 2] for k in range(7))
    order = first * 3 + [word for row in others[:-1] for word in row * 4] + others[-1] * 2
    words = pack(table[order * 3], rom.width)
    check(
        dut,
        "weight_rom_squares",
        tmp_path,
        inputs=[0] * len(words),
        expected=[word | (k % 125 == 124) << (dut.bits - 1) for k, word in enumerate(words)],
        latencies=[(k, k, WeightRom.latency) for k in range(len(words))],
    )
    with pytest.raises(ValueError, match="table of 3 words: expected 21"):
        WeightRom(table[:3], squares)


def test_a_word_a_pixel_with_fields_as_wide_as_they_need(tmp_path):
    rng = np.random.default_rng(1)
    limits = np.array([7, 0, 100, 1])
    table = rng.integers(-limits - 1, limits + 1, (6, 4))
    table[0], table[1] = limits, -limits - 1
    rom = WeightRom(table)
    assert rom.field_widths == [4, 1, 8, 2]
    assert rom.width == 8
    dut = Words(rom)
    words = pack(np.tile(table, (3, 1)), rom.width)
    last = [0, 0, 0, 0, 0, 1] * 3
    check(
        dut,
        "weight_rom",
        tmp_path,
        inputs=[0] * len(words),
        expected=[word | end << (dut.bits - 1) for word, end in zip(words, last, strict=True)],
        latencies=[(k, k, WeightRom.latency) for k in range(len(words))],
    )
