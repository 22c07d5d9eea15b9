# amaranth: UnusedElaboratable=no
import json

import pytest

from fastac.gateware.cycle_model import multipliers
from fastac.gateware.datapath import Datapath
from fastac.models.random_bundle import random_bundle, scene
from fastac.synth import resources
from fastac.synth.fits import random_pipeline

SAMPLES = json.loads(resources.SAMPLES.read_text())["samples"]


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
    assert resources.blocks(width, depth) == expected


@pytest.mark.parametrize(
    ("instance", "stage"),
    [
        ("mlp.fc0_lane1", "normals"),
        ("mlp (own logic)", "normals"),
        ("solver.column_inverse", "transforms"),
        ("solver.source", "source"),
        ("force_stream.patches", "force"),
        ("registers", "control"),
        ("depth_tags", "control"),
        ("top (own logic)", "control"),
    ],
)
def test_stages_by_instance(instance, stage):
    assert resources.stage_of(instance) == stage


def test_a_stage_that_no_sample_has():
    with pytest.raises(ValueError, match="stage unheard: no sample has it"):
        resources.predict({}, {"unheard": {}})


def test_the_committed_samples_cover_every_stage():
    assert {stage for s in SAMPLES for stage in s["features"]} == set(resources.stage_names())


@pytest.mark.parametrize(
    ("outputs", "lanes", "counted"),
    [
        (("depth", "force_z"), 1, 2756 - 1673),
        (("depth", "force_z"), 4, 2067 - 750),
        (("normals", "depth", "force_xyz"), 2, 2540 - 980),
    ],
)
def test_packets_cost_what_was_counted(tmp_path, outputs, lanes, counted):
    """Look-up tables of the modules around the datapath, by Yosys, with packets less those with video."""
    found = {}
    for streams in ("video", "packets"):
        made = random_bundle(tmp_path / streams, scene(outputs, lanes=lanes, streams=streams))
        found[streams] = resources.luts(made.pipeline)
    assert "packets" not in found["video"]
    assert found["packets"].pop("packets") == pytest.approx(counted, rel=0.02)
    assert found["packets"] == found["video"]


@pytest.mark.parametrize(
    ("settings", "counted"),
    [
        ({"outputs": ("force_z",), "size": 64, "weights": "baked"}, 545 + 32),
        ({"outputs": ("force_x", "force_z"), "size": 128, "lanes": 2, "weights": "baked"}, 601 + 2 * 32),
        ({"outputs": ("force_xyz",), "size": 128, "lanes": 4, "channels": "bgr+nir"}, 728 + 3 * 32 + 11),
    ],
)
def test_intervals_cost_what_was_counted(tmp_path, settings, counted):
    """Look-up tables of the component by Yosys, those of each axis' registers, and what the loader adds."""
    made = random_bundle(tmp_path / "bundle", scene(**settings, solver="adjoint", coverage=0.9))
    found = resources.luts(made.pipeline)
    without = resources.luts(made.pipeline.replace(interval=None))
    assert found.pop("interval") == counted
    assert found == without


def test_products_are_dsp_slices():
    """Of every sample: the architecture has as many products as Yosys finds DSP48E2."""
    for sample in SAMPLES:
        assert sample["dsp48e2"] == sum(stage["dsp48e2"] for stage in sample["counted"].values())


@pytest.mark.parametrize("weights", ["loadable", "baked"])
def test_tables_are_as_wide_as_in_hardware(tmp_path, weights):
    """A loadable table holds what any calibration may need, a baked one its own values."""
    bundle = random_bundle(
        tmp_path / "difference", scene(("depth", "force_z"), size=34, mode="difference", weights=weights)
    )
    table = Datapath(bundle.pipeline).solver.source.table
    found = [found for found in resources.memories(bundle.pipeline) if found[0] == "source"]
    assert found == [("source", 1, table.fields * table.bits, table.depth)]
    bundle = random_bundle(tmp_path / "absolute", scene(("force_z",), size=34, weights=weights))
    table = Datapath(bundle.pipeline).displacement.table
    found = [found for found in resources.memories(bundle.pipeline) if found[0] == "depth"]
    assert found == [("depth", 1, table.fields * table.bits, table.depth)]


@pytest.mark.parametrize(
    ("outputs", "settings", "stages"),
    [
        (("force_z",), {}, set()),
        (("force_z",), {"bridge_dots": True}, {"bridge", "dots"}),
        (("force_z",), {"dots": True}, {"dots"}),
        (("force_z",), {"dots": True, "bridge_dots": True}, {"bridge", "dots"}),
    ],
)
def test_features_of_dots_where_they_are_wanted(tmp_path, outputs, settings, stages):
    def features(**more):
        made = scene(outputs, size=24, solver="adjoint", **settings, **more)
        pipeline = random_bundle(tmp_path / "b", made).pipeline
        return pipeline, resources.features(pipeline)

    pipeline, found = features()
    assert found.keys() & {"bridge", "dots"} == stages
    assert set(resources.stage_names()) >= stages
    if "dots" not in stages:
        return
    followed = "dots" in settings
    assert found["dots"]["pixel_bits"] == 3 * 8
    assert (found["dots"]["window_bits"] > 0) == (found["dots"]["sum_bits"] > 0) == followed
    assert (found["dots"]["ramb36"] > 0) == followed
    if "bridge" in stages:
        assert found["bridge"]["choice_bits"] == 2 * 2 * 2 * pipeline.ratio.width
        assert pipeline.bridge.reach == 2
    _, wide = features(lanes=2)
    for stage in stages:
        for name in ("pixel_bits", "choice_bits"):
            assert wide[stage].get(name) == (2 * found[stage][name] if name in found[stage] else None)


def test_a_row_of_windows_and_the_dots_weights_are_memories(tmp_path):
    made = scene(("force_xyz",), size=24, solver="adjoint", dots=True)
    pipeline = random_bundle(tmp_path / "b", made).pipeline
    rows, weights = [found[1:] for found in resources.memories(pipeline) if found[0] == "dots"]
    windows = pipeline.follower.windows
    number, width, depth = rows
    assert (number, width) == (1, windows.mass_width + 2 * windows.moment_width)
    assert depth % 16 == 0, "rows of 10 windows"
    assert depth >= 16 * (2 * (windows.half + pipeline.follower.reach) + 1)
    assert weights == (1, 3 * 2 * pipeline.dot_force.weighted.weight_width, 9)


def test_an_estimate_says_where_it_is_from(tiny_scene, make_scene):
    found = resources.estimate(random_pipeline(tiny_scene))
    assert found["dsp48e2"]["value"] == sum(multipliers(tiny_scene).values())
    for entry in found.values():
        assert entry["value"] > 0
        assert entry["origin"].startswith("estimated: ")
        assert "%" in entry["origin"]
    wide = resources.estimate(random_pipeline(make_scene(hardware={"pixels_per_clock": 2})))
    assert wide["lut"]["value"] > 1.5 * found["lut"]["value"]
    less = resources.estimate(random_pipeline(make_scene(outputs=["normals"])))
    assert less["lut"]["value"] < found["lut"]["value"]
