# amaranth: UnusedElaboratable=no
import pytest
from amaranth import Signal

from fastac.gateware.bus.frame_timer import FrameTimer
from fastac.sim.runner import simulate

FRAME_COUNT = (1 << 32) - 10


def test_times_and_numbers(tmp_path):
    """Ten frames before their counter wraps: none of its bits stays the same."""
    timer = FrameTimer(force=True, depth=True)
    timer.frame_count = Signal(32, init=FRAME_COUNT)
    bench = "fastac.sim.benches.frame_timer"
    simulate(timer, "frame_timer", bench, tmp_path, FRAME_COUNT=str(FRAME_COUNT))


@pytest.mark.parametrize(("force", "depth"), [(True, False), (False, True)])
def test_results_that_are_not_measured_have_no_ports(force, depth):
    members = FrameTimer(force=force, depth=depth).signature.members
    assert ("result_valid" in members, "last_to_force" in members) == (force, force)
    assert ("depth_done" in members, "first_to_depth" in members) == (depth, depth)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"force": False, "depth": False}, "force False, depth False, normals False: expected at least one"),
        ({"force": True, "depth": True, "frames": 6}, "frames 6: expected a power of two, 2 to 128"),
    ],
)
def test_invalid_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        FrameTimer(**arguments)
