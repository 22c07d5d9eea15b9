"""A small virtual gel: what its recording knows, whose errors add up, and the command with its table."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.models.floating.network import PixelNetwork, predict, slopes_of
from fastac.models.integer.features import integer_features
from fastac.scenes import schema
from fastac.sensor.protocol import FingertipError
from fastac.studies.depth import causes, presses, study
from fastac.studies.depth.measure import PARTS, errors_of, found_slopes, true_slopes
from fastac.studies.depth.presses import BALL_MM, SKINS, Conditions, read_skins, recorded, virtual

SCENE = """\
outputs = ["normals", "depth"]

[sensor]
geometry = "flat"
height_px = 40
width_px = 40
pitch_mm = 0.4
channels = "bgr"
source = "recorded"
"""
COUNTS = {"heavy": 3, "graded": 1, "ball": 3, "other": 5}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "gel.toml"
    path.write_text(SCENE)
    return schema.load(path)


@pytest.fixture(scope="module")
def skins(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("skins")
    presses.write_skins(folder, virtual(scene), COUNTS, 1)
    return read_skins(folder / SKINS, "heavy")


def test_a_recording_knows_the_ball_inside_circles_and_nothing_else(scene, skins):
    conditions = Conditions(circle_noise_mm=0.0, light_noise=0.0)
    data = recorded(skins, virtual(scene), conditions, 1)
    assert skins.kind.tolist() == ["heavy"] * 3 + ["ball"] * 3 + ["other"] * 5
    assert data.split.tolist() == ["train"] * 3 + ["test"] * 8 + ["train"]
    assert np.array_equal(data.frames[-1], data.background)
    assert data.valid[3:].all()
    for k in range(3):
        inside = data.valid[k]
        assert inside.sum() == pytest.approx(skins.in_contact[k].sum(), rel=0.1)
        both = inside & skins.in_contact[k]
        np.testing.assert_allclose(data.normals[k][both], skins.normals[k][both], atol=1e-5)
        assert np.isnan(data.normals[k][~inside]).all()
        assert data.indenter["radius_px"][k] < BALL_MM / 2 / data.pitch_mm


def test_larger_circles_and_other_light(scene, skins):
    def of(**changed):
        return recorded(skins, virtual(scene), Conditions(circle_noise_mm=0.0, **changed), 1)

    exact, large = of(light_noise=0.0), of(light_noise=0.0, circle_bias_mm=-0.3)
    assert (large.valid[:3].sum(axis=(1, 2)) < exact.valid[:3].sum(axis=(1, 2))).all()
    lit = of(light_noise=0.1)
    assert np.array_equal(lit.frames[-1], lit.background)
    difference = lit.frames.astype(float)[:-1].mean(axis=(1, 2)) - exact.frames[:-1].mean(axis=(1, 2))
    assert (np.abs(difference) > 1).mean() > 0.8  # presses to test with have another light too


def test_errors_by_origin_add_up(scene, skins):
    data = recorded(skins, virtual(scene), Conditions(), 1)
    k, rng = 5, np.random.default_rng(1)
    truth = true_slopes(data, k)
    keys = {
        "in_contact": skins.in_contact[k],
        "distance_radii": rng.uniform(0, 5, truth.shape[:2]),
        "limit": 0.5,
        "divergence": "central",
    }
    steep = errors_of(np.clip(truth, -0.5, 0.5), data, k, **keys)
    assert steep["contact"] == steep["shoulder"] == steep["beyond"] == 0
    assert steep["limit"] < -1  # the ball is steeper than that
    keys["limit"] = 9
    wrong = errors_of(0.8 * truth, data, k, **keys)
    assert wrong["contact"] < 0 == wrong["limit"]
    assert wrong["border"] == steep["border"]
    assert wrong["solver"] == steep["solver"]
    # The sum is of the deepest point, and the largest depth found may lie beside it.
    for found in (steep, wrong):
        assert found["depth"] == pytest.approx(sum(found[part] for part in PARTS), abs=2)


def test_slopes_are_found_as_the_network_was_trained(skins, scene):
    data, network = recorded(skins, virtual(scene), Conditions(), 1), PixelNetwork(5, hidden=(4,))
    smoothed = slopes_of(predict(network, integer_features(data.frames[3], data.background, 8)), 4)
    at_rest = slopes_of(predict(network, integer_features(data.background, data.background)), 4)
    np.testing.assert_array_equal(found_slopes(network, data, 3, 4, 8), smoothed - at_rest)
    assert (found_slopes(network, data, 3, 4) != smoothed - at_rest).any()


def test_what_is_no_flat_gel_is_refused(tiny_scene):
    with pytest.raises(FingertipError, match="tiny: expected a flat gel"):
        virtual(tiny_scene)


def test_unknown_causes_are_refused():
    with pytest.raises(ValueError, match="--cause 'no': expected one of 'as recorded', "):
        causes.named(["no"])


def test_command(tmp_path, monkeypatch):
    path = tmp_path / "gel.toml"
    path.write_text(SCENE)
    monkeypatch.setattr(study, "COUNTS", COUNTS)
    monkeypatch.setitem(study.SHORT, "normals_epochs", 2)
    arguments = ["study", "depth", str(path), "--seeds", "1", "--no-progress"]
    smoothed, less_smoothed = (next(c.name for c in causes.CAUSES if c.smoothing_px == px) for px in (8, 2))
    arguments += ["--cause", "slope_limit 1", "--cause", smoothed, "--cause", less_smoothed]
    found = CliRunner().invoke(main, [*arguments, "-o", str(tmp_path / "out")], catch_exceptions=False)
    assert "slope_limit 1" in found.output
    assert "as recorded: error at the deepest point by its origin" in found.output
    content = json.loads((tmp_path / "out" / "depth.json").read_text())
    assert content["seeds"] == [1]
    assert [len(seed) for seed in content["errors"]["as recorded"]] == [8]
    assert content["errors"][smoothed] != content["errors"][less_smoothed]
    assert (tmp_path / "out" / "depth.png").stat().st_size
