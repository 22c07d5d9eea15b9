# amaranth: UnusedElaboratable=no
"""Sums over the dots in contact: all values, either input first, and frames of dots that wait."""

import numpy as np
import pytest
from dots import follower, packed, shift_payloads
from slip import THRESHOLD, situations

from fastac.gateware.slip.rigid_sums import KEPT_FRAMES, RigidSums, sums_layout
from fastac.models.integer.dot_spread import DotSpread
from fastac.sim.amaranth_simulator import run_streams

FOLLOWER = follower(36, 36)
SPREAD = DotSpread.of_follower(FOLLOWER, THRESHOLD)
COUNT = len(SPREAD.place)
ORDER = np.random.default_rng(3).permutation(COUNT)
FRAMES = 2 * KEPT_FRAMES + 1


def expected(shift, seen, displacement) -> list[int]:
    """The sums of every frame, by their definition."""
    chosen = SPREAD.contact(displacement, seen)
    u, v = np.moveaxis(np.where(chosen[..., None], shift, 0), -1, 0)
    x, y = np.moveaxis(np.where(chosen[..., None], SPREAD.xy, 0), -1, 0)
    terms = {"n": chosen, "u": u, "v": v, "x": x, "y": y}
    terms |= {"square": u * u + v * v, "turn": x * v - y * u, "far": x * x + y * y}
    layout = sums_layout(SPREAD)
    sums = [terms[name].sum(axis=1) for name in layout.members]
    return [packed(layout, values) for values in zip(*sums, strict=True)]


def contacts(displacement) -> list[int]:
    touching = SPREAD.contact(displacement, np.ones(COUNT, bool))[:, ORDER]
    return [sum(int(bit) << k for k, bit in enumerate(frame)) for frame in touching]


@pytest.mark.parametrize("stall", [0, 0.4])
@pytest.mark.parametrize("first", ["dots", "contact", "neither"])
@pytest.mark.quick("dots-0", "contact-0", "neither-0.4")
def test_sums_of_every_frame(first, stall):
    known = situations(FOLLOWER, SPREAD, FRAMES)
    dut = RigidSums(SPREAD, FOLLOWER, ORDER)
    inputs = {"dots": shift_payloads(FOLLOWER, *known[:2]), "contact": contacts(known[2])}
    start = {"dots": {"contact": 2000}, "contact": {"dots": 200}, "neither": {}}[first]
    found, taken = run_streams(dut, inputs, {"o": FRAMES}, start=start, stall=stall)
    assert found["o"] == expected(*known)
    if not stall:
        begun = max(taken["contact"][0], taken["dots"][COUNT - 1] + 1)
        assert taken["o"][0] - begun == dut.latency == COUNT + 5
    if first == "dots" and not stall:
        assert taken["dots"][KEPT_FRAMES * COUNT - 1] < 2000 <= taken["dots"][KEPT_FRAMES * COUNT]


def test_four_products():
    assert RigidSums.multipliers == 4
