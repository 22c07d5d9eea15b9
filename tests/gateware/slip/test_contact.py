# amaranth: UnusedElaboratable=no
"""Contact of each dot from the displacements as they come: all values, lanes, orders, pauses and frames."""

import numpy as np
import pytest
from amaranth import signed, unsigned
from dots import follower
from slip import BITS, THRESHOLD, displacement_beats, situations

from fastac.gateware.slip.contact import DotContact
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

SIDE = 36
FOLLOWER = follower(SIDE, SIDE)
SPREAD = DotSpread.of_follower(FOLLOWER, THRESHOLD)


def contact(**settings) -> DotContact:
    return DotContact(SPREAD, signed(BITS), rows=SIDE - 2, **settings)


@pytest.mark.parametrize("stall", [0, 0.4])
@pytest.mark.parametrize("rows_reversed", [False, True])
@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.quick("1-False-0", "2-True-0.4", "4-False-0.4", "4-True-0")
def test_every_dot_s_displacement_is_compared(lanes, rows_reversed, stall):
    _, _, displacement = situations(FOLLOWER, SPREAD, 7)
    # Values about the threshold, each at a dot of a frame of its own.
    for k, (column, row) in enumerate(SPREAD.place[:3]):
        displacement[5, row, column] = THRESHOLD + k - 1
    dut = contact(lanes=lanes, rows_reversed=rows_reversed)
    beats = displacement_beats(displacement, lanes, rows_reversed=rows_reversed)
    found, taken = run_streams(dut, beats, {"o": len(displacement)}, stall=stall)
    touching = SPREAD.contact(displacement, np.ones(len(SPREAD.place), bool))[:, dut.order]
    assert found["o"] == [sum(int(bit) << k for k, bit in enumerate(frame)) for frame in touching]
    assert {0, (1 << len(dut.order)) - 1} <= set(found["o"])
    if not stall:
        per_frame = len(beats) // len(displacement)
        last = taken["i"][per_frame - 1 :: per_frame]
        assert [at - end for at, end in zip(taken["o"], last, strict=True)] == [dut.latency] * len(last)
        assert np.diff(taken["i"]).max() == 1, "no frame waits for the one before"


def test_dots_come_in_the_order_of_the_rows():
    rows = SPREAD.place[:, 1]
    for rows_reversed, sign in ((False, 1), (True, -1)):
        order = contact(lanes=2, rows_reversed=rows_reversed).order
        assert (np.diff(sign * rows[order]) >= 0).all()
        assert sorted(order) == list(range(len(rows)))


def test_two_dots_in_a_beat_are_refused():
    place = np.array([[4, 3], [7, 3], [9, 9]])
    near = DotSpread(place, 0, 10)
    message = "dot at 5, 4 px: another is in the same beat of 4 pixels"
    with pytest.raises(ValueError, match=message):
        DotContact(near, unsigned(BITS), rows=20, lanes=4, rows_reversed=False)
    DotContact(near, unsigned(BITS), rows=20, lanes=2, rows_reversed=False)
