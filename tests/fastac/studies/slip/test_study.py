"""The study of slip from the command line: its files, its tables, and what it says of scenes without slip."""

import json

import numpy as np
import pytest
from command_line import fail, succeed

from fastac.models.integer import bundle as bundles
from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.protocol import FingertipError
from fastac.studies.slip import drags, study

OBJECTS = {"ball 6 mm": Ball(6.0), "ball 8 mm": Ball(8.0)}


@pytest.fixture(scope="module")
def written(slip_bundle, tiny_rig_cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp("slip") / "s"
    content = study.run(slip_bundle, folder, objects=OBJECTS, store=tiny_rig_cache, progress=False)
    return folder, content


def test_what_it_writes(written):
    folder, content = written
    assert json.loads((folder / "slip.json").read_text()) == content
    assert (folder / "slip.png").read_bytes().startswith(b"\x89PNG")
    assert content["source"] == "simulated"
    assert list(content["by_object"]) == list(OBJECTS)
    assert content["left_out"] == []


def test_counts_are_those_of_the_drags(written):
    _, content = written
    joined = {
        key: np.concatenate([np.array(drag[key]) for drag in content["drags"]])
        for key in ("sticking", "slip_px", "slip_dots", "slipping", "true_slip_dots")
    }
    known = np.minimum(joined["slip_dots"], joined["true_slip_dots"]) >= 3
    everything = content["all"]
    assert everything["states"] == len(known) == len(OBJECTS) * 2 * 2 * 2 * len(drags.SHARES)
    assert everything["too_few_dots"] == (joined["slip_dots"] < 3).sum()
    assert everything["compared"] == known.sum()
    slips = joined["sticking"] < 0.5
    assert everything["compared_slipping"] == (slips & known).sum()
    for key in ("states", "compared", "compared_slipping"):
        assert everything[key] == sum(one[key] for one in content["by_object"].values())
    clear = np.abs(joined["slip_px"] - content["limit_px"]) > 1e-3  # the limit is rounded to words
    np.testing.assert_array_equal(joined["slipping"][clear], (joined["slip_px"] > content["limit_px"])[clear])
    scene = content["limits"]["scene"]
    assert scene["hit"] == pytest.approx(joined["slipping"][slips & known].mean())
    assert scene["of_all_states"]["false_alarm"] == pytest.approx(joined["slipping"][~slips].mean())


def test_no_limit_is_better_than_the_best(written):
    _, content = written
    best, scene = content["limits"]["integers"], content["limits"]["scene"]
    assert best["limit"] == content["all"]["integers"]["best_limit"]
    assert best["hit"] - best["false_alarm"] >= scene["hit"] - scene["false_alarm"]


def test_tables(written):
    quality, spread, limits = study.tables(written[1])
    for table in (quality, spread, limits):
        assert all(len(row) == len(table.head) for row in table.rows)
    assert [row[0] for row in quality.rows] == [row[0] for row in spread.rows] == [*OBJECTS, "all"]
    assert limits.rows[0][0] == "slip.limit_px of the scene"
    assert "simulated" in quality.note


def test_the_command(slip_bundle, tiny_rig_cache, tmp_path, monkeypatch):
    monkeypatch.setattr(study, "drags", lambda scene, _: drags.drags(scene, {"ball": Ball(8.0)})[:2])
    bundles.save(tmp_path / "bundle", slip_bundle.pipeline, slip_bundle.floats)
    arguments = (tmp_path / "bundle", "--store", tiny_rig_cache, "--no-progress", "-o", tmp_path / "s")
    output = succeed("study", "slip", *arguments).output
    assert "Do fewer than half of the nodes in contact stick?" in output
    assert output.splitlines()[-1] == f"written: {tmp_path}/s/slip.json, .png"
    assert "output slip" in succeed("study", "slip", "--help").output


def test_a_scene_without_slip(slip_bundle, tmp_path):
    scene = slip_bundle.scene.model_copy(update={"outputs": ("force_xyz",)})
    bundles.save(tmp_path / "bundle", slip_bundle.pipeline.replace(scene=scene), slip_bundle.floats)
    line = fail("study", "slip", tmp_path / "bundle", "-o", tmp_path / "s")
    assert line == "study slip: outputs = force_xyz: expected slip among them"
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": ["force_z"]}, "study slip: outputs = force_z: expected force_xyz"),
        ({"outputs": ["force_xyz"]}, r"study slip: sensor\.elastomer\.friction = 0: expected more"),
    ],
)
def test_scenes_that_cannot_show_it(changes, message, make_scene):
    with pytest.raises(FingertipError, match=message):
        study.require_slip(make_scene(**changes))


def test_nothing_that_contact_carries(slip_bundle, tiny_rig_cache, tmp_path, monkeypatch):
    monkeypatch.setattr(drags, "PLACES", ((50.0, 0.0),))
    with pytest.raises(FingertipError, match="study slip: no drag is carried; Ball at x = 50 mm"):
        study.run(slip_bundle, tmp_path, objects=OBJECTS, store=tiny_rig_cache, progress=False)
    assert not any(tmp_path.iterdir())
