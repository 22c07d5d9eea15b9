# amaranth: UnusedElaboratable=no
import json

import pytest

from fastac.gateware.cycle_model import multipliers
from fastac.models.random_bundle import random_bundle, scene
from fastac.synth.estimates import resources
from fastac.synth.estimates.stages import stage_names
from fastac.synth.fits import random_pipeline

SAMPLES = json.loads(resources.SAMPLES.read_text())["samples"]


def test_a_stage_that_no_sample_has():
    with pytest.raises(ValueError, match="stage unheard: no sample has it"):
        resources.predict({}, {"unheard": {}})


def test_the_committed_samples_cover_every_stage():
    assert {stage for s in SAMPLES for stage in s["features"]} == set(stage_names())


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


@pytest.mark.parametrize(
    ("window", "channels", "lanes", "size", "luts", "ramb36"),
    [
        (2, "bgr", 1, 128, 317, 1.0),
        (2, "bgr+nir", 4, 128, 1402, 0),
        (4, "bgr", 1, 128, 664, 1.5),
        (4, "bgr", "1/4", 128, 668, 1.5),
        (4, "bgr", 1, 32, 725, 0),
        (4, "bgr", 1, 96, 699, 1.5),
        (4, "bgr+nir", 2, 64, 1583, 0),
        (8, "bgr", 2, 128, 2608, 0),
        (8, "bgr+nir", 1, 128, 1647, 4.0),
        (8, "bgr+nir", 4, 128, 5549, 0),
    ],
)
def test_smoothing_costs_what_was_counted(tmp_path, window, channels, lanes, size, luts, ramb36):
    """Look-up tables and block RAM of the component alone, by Yosys."""
    settings = {"size": size, "channels": channels, "lanes": lanes, "smoothing_px": window}
    pipeline = random_bundle(tmp_path / "bundle", scene(("normals",), **settings)).pipeline
    stages = resources.predict(resources.model_of(pipeline.scene)[0], resources.features(pipeline))
    found = stages.pop("smoothing")
    assert found["lut"] == pytest.approx(luts, rel=0.09)
    assert found["ramb36"] == ramb36
    plain = pipeline.scene.network.model_copy(update={"smoothing_px": 0})
    pipeline = pipeline.replace(scene=pipeline.scene.model_copy(update={"network": plain}))
    assert stages == resources.predict(resources.model_of(pipeline.scene)[0], resources.features(pipeline))


def test_products_are_dsp_slices():
    """Of every sample: the architecture has as many products as Yosys finds DSP48E2."""
    for sample in SAMPLES:
        assert sample["dsp48e2"] == sum(stage["dsp48e2"] for stage in sample["counted"].values())


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
    assert set(stage_names()) >= stages
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
