# amaranth: UnusedElaboratable=no
"""The ratio of the sums: by Python's integers, at the bounds of every word."""

import numpy as np
import pytest
from dots import follower, packed
from slip import THRESHOLD

from fastac.gateware.slip.rigid_sums import sums_layout
from fastac.gateware.slip.spread_ratio import SpreadRatio, spread_layout
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

SMALL = DotSpread(np.array([[0, 0], [9, 0], [0, 9], [9, 9], [4, 2]]), THRESHOLD, 31)
SPREADS = {"small": SMALL, "dots": DotSpread.of_follower(follower(48, 48), THRESHOLD)}


def sums(spread: DotSpread, contact: np.ndarray, shift: np.ndarray) -> tuple[int, ...]:
    """n, Σu, Σv, Σx, Σy, Σ(u² + v²), Σ(x v − y u) and Σ(x² + y²) by name."""
    (u, v), (x, y) = shift[contact].T, spread.xy[contact].T
    found = {"n": contact.sum(), "u": u.sum(), "v": v.sum(), "x": x.sum(), "y": y.sum()}
    found |= {"square": (u * u + v * v).sum(), "turn": (x * v - y * u).sum(), "far": (x * x + y * y).sum()}
    return tuple(int(found[name]) for name in sums_layout(spread).members)


@pytest.mark.parametrize("stall", [0, 0.3])
@pytest.mark.parametrize("name", SPREADS)
@pytest.mark.quick("small-0", "dots-0.3")
def test_spread_of_any_sums(name, stall):
    spread = SPREADS[name]
    count, limit = len(spread.place), spread.shift_limit
    rng = np.random.default_rng(5)
    outwards = np.where(spread.xy < 0, -limit, limit)
    shifts = [outwards, -outwards, outwards[:, ::-1] * [-1, 1], np.full((count, 2), limit), 0 * outwards]
    shifts += list(rng.integers(-limit, limit + 1, (12, count, 2)))
    contacts = [np.ones(count, bool), *(np.arange(count) < few for few in range(5))]
    contacts += [rng.random(count) < 0.6 for _ in range(6)]
    cases = [(contact, shift) for contact in contacts for shift in shifts[: 5 if stall else None]]
    given = [packed(sums_layout(spread), sums(spread, *case)) for case in cases]
    displacement = np.full((1, 60, 60), THRESHOLD + 1)
    expected = [spread(shift, contact, displacement[0]) for contact, shift in cases]
    dut = SpreadRatio(spread)
    found, taken = run_streams(dut, given, {"o": len(cases)}, stall=stall)
    assert found["o"] == [packed(spread_layout(spread), values) for values in expected]
    assert max(int(value) for value, _ in expected) > 0.9 * spread.bounds["spread"]
    if not stall:
        assert taken["o"][0] == dut.latency
        assert np.diff(taken["o"]).tolist() == [dut.interval] * (len(cases) - 1)
