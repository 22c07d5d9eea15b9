# amaranth: UnusedElaboratable=no
import re

import numpy as np
import pytest
from amaranth.sim import Simulator

from fastac.gateware.force.block_address import BlockAddress
from fastac.models.integer.force import WeightedSum


def addresses(dut: BlockAddress, count: int) -> list[tuple[int, int]]:
    """What `address` and `last` are in the beats taken, with clocks between them in which none is."""
    found, rng = [], np.random.default_rng(1)

    async def take(ctx):
        while len(found) < count:
            taken = bool(rng.random() < 0.7)
            ctx.set(dut.take, taken)
            if taken:
                found.append((ctx.get(dut.address), ctx.get(dut.last)))
            await ctx.tick()

    simulator = Simulator(dut)
    simulator.add_clock(1e-6)
    simulator.add_testbench(take)
    simulator.run()
    return found


@pytest.mark.parametrize("cut_rows", [0, 1])
@pytest.mark.parametrize(("side", "width"), [(2, 1), (2, 2), (4, 1), (8, 4)])
@pytest.mark.parametrize(("rows", "beats"), [(2, 2), (6, 4), (7, 5), (9, 1)])
def test_each_beat_has_the_word_of_its_square(rows, beats, side, width, cut_rows):
    dut = BlockAddress(rows=rows, beats=beats, side=side, width=width, cut_rows=cut_rows)
    row, beat = np.indices((rows, beats))
    square = (row + cut_rows) // side * -(-beats // width) + beat // width
    assert dut.words == square.max() + 1
    last = np.arange(rows * beats) == rows * beats - 1
    expected = list(zip(square.ravel().tolist(), last.tolist(), strict=True)) * 3
    assert addresses(dut, len(expected)) == expected


@pytest.mark.parametrize(("lanes", "width", "words"), [(1, 4, 2 * 3), (2, 2, 2 * 3), (4, 1, 2 * 3)])
def test_squares_of_a_sum(lanes, width, words):
    weight = np.ones((1, 5, 10, 2), int)
    weighted = WeightedSum(weight, np.zeros(1, int), 6, True, block_px=4, cut_rows=3)
    dut = BlockAddress.of(weighted, lanes)
    assert (dut.rows, dut.side, dut.cut_rows, dut.width) == (5, 4, 3, width)
    assert dut.words == words


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"side": 3}, "side: 3: expected a power of two"),
        ({"width": 0}, "width: 0: expected a power of two"),
        ({"cut_rows": 2}, "cut_rows: 2: expected 0 to 1"),
    ],
)
def test_invalid_arguments(wrong, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        BlockAddress(**{"rows": 4, "beats": 4, "side": 2, "width": 2} | wrong)
