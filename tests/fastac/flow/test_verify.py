# amaranth: UnusedElaboratable=no
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fastac.flow import verify
from fastac.gateware.target.device import XCZU19EG
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.scenes.schema import SceneError
from fastac.sim.check_top import Report
from fastac.sim.runner import QUICK


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("random_bundle") / "bundle"


@pytest.fixture(scope="module")
def bundle(folder):
    return random_bundle(folder, scene(("normals",)))


def campaign(bundle, data, index, lanes, place):
    return verify.run(bundle, data, np.array(index), lanes, place, store=place / "store", **SETTINGS)


def with_weights(bundle, tmp_path, weights):
    return verify.derive(bundle, tmp_path / weights, pace=1, weights=weights)


class TestDerive:
    @pytest.mark.parametrize("lanes", [2, 4])
    def test_only_the_lanes_differ(self, tiny_bundle, tiny_data, tmp_path, lanes):
        derived = verify.derive(tiny_bundle, tmp_path / "bundle", pace=lanes)
        assert derived.digest != tiny_bundle.digest
        assert bundles.load(tmp_path / "bundle").digest == derived.digest
        assert derived.scene.hardware.pixels_per_clock == lanes
        hardware = derived.scene.hardware.model_copy(update={"pixels_per_clock": 1})
        assert derived.scene.model_copy(update={"hardware": hardware}) == tiny_bundle.scene
        images = tiny_data.frames[:3]
        found, expected = Emulator(derived.pipeline).run(images), Emulator(tiny_bundle.pipeline).run(images)
        for name in ("normal_words", "depth_words", "force_raw"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))

    def test_weights_change_words_but_no_value(self, tiny_bundle, tiny_data, tmp_path):
        images = tiny_data.frames[:3]
        found = {}
        for weights in ("loadable", "baked"):
            derived = with_weights(tiny_bundle, tmp_path, weights)
            assert derived.scene.hardware.weights == weights
            assert {layer.loadable for layer in derived.pipeline.layers} == {weights == "loadable"}
            width = derived.pipeline.layers[-1].accumulator_width
            assert derived.pipeline.ratio.normal_width == width
            found[weights] = (derived.digest, width, Emulator(derived.pipeline).run(images))
        assert found["loadable"][0] != found["baked"][0]
        assert found["loadable"][1] > found["baked"][1]
        for name in ("normal_words", "depth_words", "force_raw"):
            np.testing.assert_array_equal(
                getattr(found["loadable"][2], name), getattr(found["baked"][2], name)
            )

    def test_lanes_that_the_scene_cannot_have(self, bundle, tmp_path):
        with pytest.raises(SceneError, match=r"^scene random_bundle: hardware.pixels_per_clock = 3: "):
            verify.derive(bundle, tmp_path / "bundle", pace=3)
        assert not (tmp_path / "bundle").exists()


def hold(monkeypatch, dsps: int) -> None:
    """Let every part have so many DSP slices."""
    monkeypatch.setattr(verify, "device_of", lambda scene: replace(XCZU19EG, dsps=dsps))


class TestFit:
    """With as many DSP slices as loadable weights need, and with one fewer."""

    @pytest.fixture
    def needed(self, bundle, tmp_path):
        loadable = with_weights(bundle, tmp_path, "loadable")
        return loadable, sum(verify.TopZynq(loadable).datapath.multipliers.values())

    def test_what_fits_stays(self, needed, tmp_path, monkeypatch):
        loadable, count = needed
        hold(monkeypatch, count)
        derived, note = verify.fit(loadable, tmp_path / "fit", 1)
        assert (derived.digest, note) == (loadable.digest, "")

    def test_what_does_not_is_baked_and_says_so(self, needed, tmp_path, monkeypatch):
        loadable, count = needed
        hold(monkeypatch, count - 1)
        derived, note = verify.fit(loadable, tmp_path / "fit", 1)
        assert note == f"baked: loadable weights need {count} of {count - 1} DSP48E2"
        assert not derived.pipeline.layers[0].loadable
        assert sum(verify.TopZynq(derived).datapath.multipliers.values()) < count

    def test_baked_weights_stay(self, bundle, tmp_path, monkeypatch):
        baked = with_weights(bundle, tmp_path, "baked")
        hold(monkeypatch, -1)
        derived, note = verify.fit(baked, tmp_path / "fit", 1)
        assert derived.digest == baked.digest
        assert note.startswith("too large for the part, ")
        assert note.endswith(" of -1 DSP48E2: simulated all the same")

    def test_below_a_pixel_a_clock_baked_weights_take_as_many(self, needed, tmp_path, monkeypatch):
        loadable, _ = needed
        derived, _ = verify.fit(loadable, tmp_path / "any", "1/2")
        count = sum(verify.TopZynq(derived).datapath.multipliers.values())
        hold(monkeypatch, count - 1)
        derived, note = verify.fit(loadable, tmp_path / "fit", "1/2")
        assert derived.pipeline.layers[0].loadable
        assert note == f"too large for the part, {count} of {count - 1} DSP48E2: simulated all the same"


def test_special_frames():
    background = np.full((16, 6, 3), 100, np.uint8)
    black, white, checkerboard, bright, pixels, rows, extremes = verify.special_frames(background)
    assert (black == 0).all()
    assert (white == 255).all()
    assert checkerboard[0, :, 0].tolist() == [0, 255, 0, 255, 0, 255]
    assert checkerboard[:4, 0, 2].tolist() == [0, 255, 0, 255]
    assert (bright == 255).sum() == 3
    assert (bright == 100).sum() == 16 * 6 * 3 - 3
    missing = (pixels == 0).all(axis=2)
    assert 0 < missing.sum() < 16
    assert (pixels[~missing] == 100).all()
    assert (rows == 0).all(axis=(1, 2)).nonzero()[0].tolist() == [8, 9]
    assert set(np.unique(extremes)) == {0, 255}
    assert len(verify.SPECIAL) == 7
    assert (background == 100).all()


SETTINGS = {"build_args": QUICK, "progress": False}


@pytest.fixture(scope="module")
def data(bundle):
    return SimpleNamespace(frames=frames(bundle.pipeline.background, (10, 40, 255)))


def test_campaign(bundle, folder, data, tmp_path):
    content = campaign(folder, data, [0, 2], (2,), tmp_path)
    assert json.loads((tmp_path / "verify.json").read_text()) == content
    assert content["bundle_sha256"] == bundle.digest
    assert (content["frame_indices"], content["special_frames"]) == ([0, 2], 7)
    rows = content["rows"]
    assert [(row["pixels_per_clock"], row["stalls"], row["frames"]) for row in rows] == [
        (2, False, 9),
        (2, True, 2),
    ]
    for row in rows:
        assert row["mismatches"] == 0
        assert row["values_compared"] == row["frames"] * 16 * 16 * 3
        assert row["cycles"] >= row["frames"] * 128
        assert row["simulation_s_per_frame"] > 0
        assert ("build_s" in row) == ("elaboration_s" in row) == (not row["stalls"])
        assert bundles.load(tmp_path / "px_2" / "bundle").digest == row["bundle_sha256"] != bundle.digest
    assert rows[1]["cycles"] > 2 * 128 / 0.7
    assert rows[0]["verilog_sha256"] == rows[1]["verilog_sha256"]


class Simulator:
    """Replaces `sim.check_top.simulate` and records its arguments."""

    def __init__(self):
        self.asked, self.fails_at = [], None

    def __call__(self, derived, source, images, result, folder, *, stall, **settings):
        np.testing.assert_array_equal(result.normal_words, derived.pipeline.normals(images))
        if len(self.asked) == self.fails_at:
            raise OSError(28, "No space left on device")
        self.asked.append((derived.scene.hardware.pixels_per_clock, any(stall), len(images)))
        return Report(len(images), 100, 0, "", {}, 0, 1000, wall_s={"build": 1.0, "simulate": 2.0})


class TestResuming:
    @pytest.fixture
    def simulator(self, monkeypatch):
        found = Simulator()
        monkeypatch.setattr(verify, "simulate", found)
        return found

    def test_goes_on_where_it_was(self, bundle, folder, data, tmp_path, simulator):
        simulator.fails_at = 3
        with pytest.raises(OSError, match="No space left"):
            campaign(folder, data, [0, 2], (1, 2), tmp_path)
        done = [(1, False, 9), (1, True, 2), (2, False, 9)]
        assert simulator.asked == done
        assert len(json.loads((tmp_path / "verify.json").read_text())["rows"]) == 3
        simulator.fails_at = None
        content = campaign(folder, data, [0, 2], (1, 2), tmp_path)
        assert simulator.asked == [*done, (2, True, 2)]
        assert campaign(folder, data, [0, 2], (1, 2), tmp_path) == content
        assert len(simulator.asked) == 4
        assert len({row["verilog_sha256"] for row in content["rows"]}) == 2

    def test_only_what_changed(self, bundle, folder, data, tmp_path, simulator):
        campaign(folder, data, [0, 2], (1,), tmp_path)
        # The stalled frames are the first and the last: another second one does not concern them.
        campaign(folder, data, [0, 1], (1,), tmp_path)
        assert simulator.asked[2:] == [(1, False, 9)]
        verify.derive(bundle, tmp_path / "other", pace=1, weights="baked")
        campaign(tmp_path / "other", data, [0, 1], (1,), tmp_path)
        assert simulator.asked[3:] == [(1, False, 9), (1, True, 2)]


ROW = {
    "pixels_per_clock": 4,
    "weights": "baked",
    "note": "baked: loadable weights need 3 of 2 DSP48E2",
    "stalls": False,
    "frames": 14,
    "values_compared": 12_345,
    "mismatches": 0,
    "cycles": 4567,
    "elaboration_s": 60.04,
    "build_s": 181.0,
    "simulation_s_per_frame": 3.14,
}


def test_table():
    stalled = {k: v for k, v in ROW.items() if k not in ("elaboration_s", "build_s")} | {"stalls": True}
    lines = verify.table({"rows": [ROW, stalled]}).splitlines()
    assert lines[0].split() == [
        *("px/clock", "weights", "stalls", "frames", "values", "mismatches", "cycles"),
        *("elaboration_s", "build_s", "simulation_s_per_frame"),
    ]
    assert lines[1].split() == ["4", "baked", "14", "12,345", "0", "4,567", "60.0!", "181.0!", "3.1"]
    assert lines[2].split() == ["4", "baked", "random", "14", "12,345", "0", "4,567", "3.1"]
    assert lines[3:] == ["4 px/clock: baked: loadable weights need 3 of 2 DSP48E2"]
