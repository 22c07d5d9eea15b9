# amaranth: UnusedElaboratable=no
"""The spread from the sums: every value to the last bit, in as many clocks as stated."""

import dots
import numpy as np
import pytest
import slips
from amaranth.back import rtlil

from fastac.gateware.slip.spread_ratio import SpreadRatio, spread_layout
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check

GRID = np.stack(np.meshgrid(*2 * [1 + 5 * np.arange(4)]), axis=-1).reshape(-1, 2)
LIMIT = 700
SPREADS = {
    "square": DotSpread(GRID, 0, LIMIT),
    "12 at random": DotSpread(np.random.default_rng(3).permutation(400)[:12, None] // (1, 20) % 20, 0, 55),
    "close": DotSpread(np.stack(np.divmod(np.arange(12), 4), axis=-1), 0, 55),
    "in a row": DotSpread(np.array([(k, 3) for k in (0, 2, 7, 9)]), 0, 20),
    "one": DotSpread(np.array([(4, 2)]), 0, 9),
    "three": DotSpread(np.array([(0, 0), (1, 0), (0, 1)]), 0, 1),
}


def cases(spread: DotSpread, count: int) -> tuple[list[int], list[int]]:
    shifts, contact = slips.frames(spread, count)
    displacement = np.zeros((len(shifts), *spread.place.max(axis=0)[::-1] + 1), int)
    column, row = spread.place.T
    displacement[:, row, column] = contact
    found, touching = spread(shifts, np.ones(contact.shape, bool), displacement)
    layout = spread_layout(spread)
    expected = [dots.packed(layout, values) for values in zip(found, touching, strict=True)]
    return slips.sum_payloads(spread, shifts, contact), expected


@pytest.mark.parametrize("name", SPREADS)
def test_values_and_clocks(name):
    spread = SPREADS[name]
    dut, (inputs, expected) = SpreadRatio(spread), cases(spread, 15)
    found, taken = run_streams(dut, inputs, {"o": len(expected)})
    assert found["o"] == expected
    assert taken["o"][0] == dut.latency
    assert set(np.diff(taken["o"])) == {dut.interval}
    assert set(np.subtract(taken["o"], taken["i"])) == {1}, "the sums stay until the spread is found"


@pytest.mark.full
@pytest.mark.mutate
def test_stream_rules_in_verilator(tmp_path):
    """Of dots next to each other the divisor is so small that the numerator's last bits count."""
    spread = SPREADS["close"]
    inputs, expected = cases(spread, 400)
    dut = SpreadRatio(spread)
    latencies = [(k, k, 1) for k in range(len(inputs))]
    latencies += [(k, k + 1, 1 + dut.interval) for k in range(len(inputs) - 1)]
    check(dut, "ratio", tmp_path, inputs=inputs, expected=expected, latencies=latencies)


def test_there_is_no_multiplier():
    text = rtlil.convert(SpreadRatio(SPREADS["square"]))
    assert "$add" in text
    assert "$mul" not in text
    assert "$div" not in text
