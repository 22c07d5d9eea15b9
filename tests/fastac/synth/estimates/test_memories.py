# amaranth: UnusedElaboratable=no
import pytest

from fastac.gateware.datapath import Datapath
from fastac.models.random_bundle import random_bundle, scene
from fastac.synth.estimates.memories import blocks, memories


@pytest.mark.parametrize(
    ("width", "depth", "expected"),
    [
        (1, 1, 0.5),
        (36, 512, 0.5),
        (72, 512, 1),
        (36, 1024, 1),
        (32, 16384, 16),
        (2, 16384, 1),
        (17 * 63, 126, 15),
    ],
)
def test_blocks(width, depth, expected):
    assert blocks(width, depth) == expected


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_tables_are_as_wide_as_in_hardware(tmp_path, weights):
    """A loadable table holds what any calibration may need, a baked one its own values."""
    bundle = random_bundle(
        tmp_path / "difference", scene(("depth", "force_z"), size=34, mode="difference", weights=weights)
    )
    table = Datapath(bundle.pipeline).solver.source.table
    found = [found for found in memories(bundle.pipeline) if found[0] == "source"]
    assert found == [("source", 1, table.fields * table.bits, table.depth)]
    bundle = random_bundle(tmp_path / "absolute", scene(("force_z",), size=34, weights=weights))
    table = Datapath(bundle.pipeline).displacement.table
    found = [found for found in memories(bundle.pipeline) if found[0] == "depth"]
    assert found == [("depth", 1, table.fields * table.bits, table.depth)]


def test_a_row_of_windows_and_the_dots_weights_are_memories(tmp_path):
    made = scene(("force_xyz",), size=24, solver="adjoint", dots=True)
    pipeline = random_bundle(tmp_path / "b", made).pipeline
    rows, weights = [found[1:] for found in memories(pipeline) if found[0] == "dots"]
    windows = pipeline.follower.windows
    number, width, depth = rows
    assert (number, width) == (1, windows.mass_width + 2 * windows.moment_width)
    assert depth % 16 == 0, "rows of 10 windows"
    assert depth >= 16 * (2 * (windows.half + pipeline.follower.reach) + 1)
    assert weights == (1, 3 * 2 * pipeline.dot_force.weighted.weight_width, 9)
