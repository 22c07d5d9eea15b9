# amaranth: UnusedElaboratable=no
import pytest
from amaranth import Signal

from fastac.gateware.bus.frame_timer import FrameTimer
from fastac.sim.runner import simulate

FRAME_COUNT = (1 << 32) - 10


@pytest.mark.parametrize("packets", [False, True])
@pytest.mark.parametrize("results", ["force,depth", "depth,normals", "normals"])
@pytest.mark.quick("force,depth-False", "depth,normals-True")
def test_times_and_numbers(tmp_path, results, packets):
    """Ten frames before their counter wraps: none of its bits stays the same."""
    kinds = {name: name in results.split(",") for name in ("force", "depth", "normals")}
    stamps = packets and kinds["normals"] and len(results.split(",")) > 1
    timer = FrameTimer(**kinds, packets=packets, stamps=stamps)
    timer.frame_count = Signal(32, init=FRAME_COUNT)
    bench = "fastac.sim.benches.frame_timer"
    settings = {"FRAME_COUNT": str(FRAME_COUNT), "RESULTS": results, "PACKETS": str(packets)}
    simulate(timer, "frame_timer", bench, tmp_path, STAMPS=str(stamps), **settings)


@pytest.mark.parametrize(("force", "depth"), [(True, False), (False, True)])
def test_results_that_are_not_measured_have_no_ports(force, depth):
    members = FrameTimer(force=force, depth=depth).signature.members
    assert ("result_valid" in members, "last_to_force" in members) == (force, force)
    assert ("depth_done" in members, "first_to_depth" in members) == (depth, depth)
    assert not {"time", "result_time", "depth_number", "last_to_depth"} & members.keys()


@pytest.mark.parametrize(("force", "depth"), [(True, True), (False, True), (False, False)])
def test_one_kind_of_result_has_all_that_a_record_holds(force, depth):
    timer = FrameTimer(force=force, depth=depth, normals=True, packets=True)
    kind = "force" if force else "depth" if depth else "normals"
    numbered = {name for name in timer.signature.members if name.endswith("_number")}
    assert (timer.result, numbered) == (kind, {f"{kind}_number"})
    assert {"time", "result_time", f"first_to_{kind}", f"last_to_{kind}", f"{kind}_bad"} < (
        timer.signature.members.keys()
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"force": False, "depth": False}, "force False, depth False, normals False: expected at least one"),
        ({"force": True, "depth": True, "frames": 6}, "frames 6: expected a power of two, 2 to 128"),
        ({"force": True, "depth": True, "stamps": True}, "stamps True, packets False: only packets have"),
    ],
)
def test_invalid_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        FrameTimer(**arguments)
