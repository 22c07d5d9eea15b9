# amaranth: UnusedElaboratable=no
"""Which dots touch: those at whose own place the displacement is beyond the threshold; either row first."""

import numpy as np
import pytest
import slips
from amaranth import signed

from fastac.gateware.slip.contact import DotContact
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check

ROWS, BITS, THRESHOLD = 9, 5, 3
PLACES = np.array([(8, 1), (0, 0), (3, 2), (5, 5), (1, 5), (4, 8), (8, 8), (0, 7)])
"""In the first and the last beat, in all lanes, two in a row."""


def component(lanes: int, *, rows_reversed: bool, places=PLACES) -> DotContact:
    spread = DotSpread(places, THRESHOLD, 100)
    return DotContact(spread, signed(BITS), rows=ROWS, lanes=lanes, rows_reversed=rows_reversed)


def displacements(count: int) -> np.ndarray:
    """Everywhere one value, around the threshold and extreme ones; beyond it at one dot alone; at random."""
    values = (-16, -1, 0, THRESHOLD, THRESHOLD + 1, 15)
    alike = [np.full((ROWS, ROWS), value) for value in values]
    single = []
    for column, row in PLACES:
        for beyond in (True, False):
            field = np.full((ROWS, ROWS), THRESHOLD + (not beyond))
            field[row, column] = THRESHOLD + beyond
            single.append(field)
    rng = np.random.default_rng(1)
    return np.concatenate([alike, single, rng.choice(values, (count, ROWS, ROWS))])


def cases(dut: DotContact, count: int, *, rows_reversed: bool) -> tuple[list[int], list[int]]:
    given = displacements(count)
    contact = dut.spread.contact(given, np.ones((len(given), len(PLACES)), bool))
    assert {0, 1, len(PLACES) - 1, len(PLACES)} <= set(contact.sum(axis=1).tolist())
    beats = slips.displacement_payloads(given, BITS, dut.lanes, rows_reversed=rows_reversed)
    return beats, slips.contact_payloads(contact, dut.order)


@pytest.mark.parametrize("rows_reversed", [False, True])
@pytest.mark.parametrize("lanes", [1, 2, 4])
def test_at_full_rate(lanes, rows_reversed):
    """The input never waits, and each frame's contact comes a clock after its last beat."""
    dut = component(lanes, rows_reversed=rows_reversed)
    inputs, expected = cases(dut, 3, rows_reversed=rows_reversed)
    found, taken = run_streams(dut, inputs, {"o": len(expected)})
    assert found["o"] == expected
    beats = ROWS * -(-ROWS // lanes)
    assert taken["i"] == list(range(len(inputs)))
    assert taken["o"] == [clock + dut.latency for clock in taken["i"][beats - 1 :: beats]]


@pytest.mark.full
@pytest.mark.mutate
def test_stream_rules_in_verilator(tmp_path):
    dut = component(4, rows_reversed=True)
    inputs, expected = cases(dut, 20, rows_reversed=True)
    check(dut, "dot_contact", tmp_path, inputs=inputs, expected=expected, elastic=True)


def test_dots_are_told_in_the_order_in_which_they_come_by():
    rows = PLACES[component(1, rows_reversed=False).order][:, 1]
    assert (np.diff(rows) >= 0).all()
    rows = PLACES[component(1, rows_reversed=True).order][:, 1]
    assert (np.diff(rows) <= 0).all()


def test_two_dots_in_a_beat_are_refused():
    close = np.concatenate([PLACES, [[2, 5]]])
    component(1, rows_reversed=False, places=close)
    component(2, rows_reversed=False, places=close)
    with pytest.raises(ValueError, match="dot at 2, 6 px: another is in the same beat of 4 pixels"):
        component(4, rows_reversed=False, places=close)
