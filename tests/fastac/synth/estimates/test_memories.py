# amaranth: UnusedElaboratable=no
import pytest

from fastac.gateware import datapath_stages
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


@pytest.mark.parametrize("lanes", [1, 4, "1/4"])
@pytest.mark.parametrize("block_px", [1, 2, 8])
def test_weights_of_squares_take_a_word_each(tmp_path, block_px, lanes):
    bends = {"band_mm": 0.001, "deep_mm": 0.003, "kernel": "collapsed", "clamp": False}
    made = scene(("depth", "force_xyz"), size=32, lanes=lanes, block_px=block_px, **bends)
    pipeline = random_bundle(tmp_path / "b", made).pipeline
    [(_, number, bits, words)] = [found for found in memories(pipeline) if found[0] == "force"]
    assert number == 1
    if lanes == "1/4":
        assert words == (-(-30 // block_px)) ** 2
        assert bits <= 3 * 4 * pipeline.force.weight_width
        return
    rom, _ = datapath_stages.force(pipeline)._weights()
    assert words == len(rom.table)
    if block_px == 1:
        assert bits == len(rom.word.as_value())
    else:
        assert 0.9 * bits < sum(rom.field_widths) <= bits
