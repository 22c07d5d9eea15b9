"""Bundles reconstruct the test objects; what they find is compared with the skin itself."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.sensor.protocol import FingertipError
from fastac.studies.demos import reconstruction
from fastac.studies.demos.reconstruction_figures import arrows, force_maps, page

ONE = Path("one")


@pytest.fixture(scope="module")
def shown(tiny_bundle):
    return reconstruction.reconstruct({ONE: tiny_bundle}, 0.1, progress=False)


def of_scene(bundle, scene):
    return replace(bundle, pipeline=bundle.pipeline.replace(scene=scene))


def test_every_object_is_reconstructed(shown, tiny_bundle):
    assert [item.name for item in shown] == ["strawberry", "fingerprint", "led_pads"]
    for item in shown:
        (found,) = item.found.values()
        assert found.frame.shape == (16, 16, 4)
        errors = found.errors(item.truth)
        assert errors["contact_normal_mae_deg"] < 15
        assert errors["depth_mae_mm"] < 0.1
        depth = np.abs(found.result.depth_mm[0] - item.truth.pressed.depth_mm)
        assert errors["contact_depth_mae_mm"] == pytest.approx(depth[item.truth.pressed.in_contact].mean())
    assert reconstruction.reconstruct({ONE: tiny_bundle}, None, progress=False)[0].truth.pressed.force_n[
        2
    ] == pytest.approx(3 * 0.06)


def test_summary_of_one_object(shown):
    content = reconstruction.summary(shown[:1])
    assert content["load_n"] == shown[0].truth.pressed.pose["load_n"]
    assert content["objects"].keys() == {"strawberry"}


def test_arrows_are_the_whole_force(shown):
    for item in shown:
        feet, force = arrows(item.truth.force_map_n, item.truth.pressed.depth_mm, item.sensor)
        np.testing.assert_allclose(force.sum(axis=0), item.truth.pressed.force_n, atol=1e-9)
        assert (np.abs(feet[:, :2]) < 2).all()


def test_a_bundle_s_own_force_map_is_drawn_where_it_has_three_axes(shown):
    item = shown[0]
    (name,) = item.found
    assert list(force_maps(item)) == ["truth"]
    own = np.zeros((1, 3, 14, 14))
    own[0, :, 4, 5] = 0.1, 0.2, 0.3
    found = replace(item.found[name], result=replace(item.found[name].result, force_map_n=own))
    maps = force_maps(replace(item, found={name: found}))
    np.testing.assert_array_equal(maps[name][0][5, 6], (0.1, 0.2, 0.3))
    _, force = arrows(*maps[name], item.sensor)
    np.testing.assert_allclose(force, [(0.1, 0.2, 0.3)])
    assert f"{name}: three-axis force" in page([replace(item, found={name: found})])


def test_the_page_holds_all_and_needs_no_network(shown):
    html = page(shown)
    for word in ("strawberry", "fingerprint", "led_pads", "simulated", "scatter3d", "cone"):
        assert word in html
    assert 'src="http' not in html


def test_refuses_bundles_that_do_not_fit(tiny_bundle, make_scene):
    recorded = of_scene(tiny_bundle, make_scene(sensor={"source": "recorded"}))
    with pytest.raises(FingertipError, match=r"one: sensor\.source = 'recorded'"):
        reconstruction.check({ONE: recorded})
    other = of_scene(tiny_bundle, make_scene(name="other", sensor={"pitch_mm": 0.2}))
    with pytest.raises(FingertipError, match=r"two: sensor\.pitch_mm: differs"):
        reconstruction.check({ONE: tiny_bundle, Path("two"): other})
    with pytest.raises(FingertipError, match="two bundles of this scene and these channels"):
        reconstruction.check({ONE: tiny_bundle, Path("two"): tiny_bundle})
    flat = of_scene(tiny_bundle, make_scene(outputs=["normals"]))
    with pytest.raises(FingertipError, match=r"one: outputs = .*expected depth"):
        reconstruction.check({ONE: flat})


def test_the_command_writes_pictures_page_and_errors(tiny_folder, tmp_path):
    arguments = ["objects", str(tiny_folder), "--load-n", "0.1", "-o", str(tmp_path / "o"), "--no-progress"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    names = {path.name for path in (tmp_path / "o").iterdir()}
    assert names == {"objects.html", "objects.json", "strawberry.png", "fingerprint.png", "led_pads.png"}
    content = json.loads((tmp_path / "o" / "objects.json").read_text())
    assert (content["source"], content["load_n"]) == ("simulated", 0.1)
    assert "tiny, B G R NIR" in result.output
    assert CliRunner().invoke(main, ["objects", "-o", "x"]).exit_code == 2
