# amaranth: UnusedElaboratable=no
import pytest

from fastac.gateware.bus.frame_timer import FrameTimer
from fastac.sim.runner import simulate


def test_times_and_numbers(tmp_path):
    simulate(FrameTimer(force=True, depth=True), "frame_timer", "fastac.sim.benches.frame_timer", tmp_path)


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
