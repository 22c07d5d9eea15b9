"""The study of shapes: its errors, its table, and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import fail, succeed

from fastac.sensor.mechanics.random_indenter import KINDS
from fastac.sensor.protocol import FingertipError
from fastac.studies.shapes import study


@pytest.fixture(scope="module")
def written(tiny_rig_bundle, tiny_rig_cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes") / "s"
    two = {"one": tiny_rig_bundle, "two": tiny_rig_bundle}
    return folder, study.run(two, folder, count=2, store=tiny_rig_cache, progress=False)


def test_every_kind_of_object_for_every_bundle(written):
    folder, content = written
    assert json.loads((folder / "shapes.json").read_text()) == json.loads(json.dumps(content))
    assert list(content["by_kind"]) == [*KINDS, "bottle"]
    for found in content["by_kind"].values():
        assert found["one"] == found["two"]
        assert set(found["one"]["mae_n"]) == set("xyz")
    [table] = study.tables(content)
    assert [row[:3] for row in table.rows[:3]] == [
        ["ball", "one", "yes"],
        ["ball", "two", "yes"],
        ["cylinder", "one", "no"],
    ]
    assert all(len(row) == len(table.head) for row in table.rows)
    assert table.note.endswith("simulated")


def test_a_normal_force_that_is_a_fifth_too_small():
    true_n = np.array([[0.3, -0.4, 1.0], [0.0, 0.1, 0.5], [-0.2, 0.0, 0.8]])
    found = study.errors(true_n * [1, 1, 0.8], true_n)
    assert found["gain"] == {"shear": pytest.approx(1), "normal": pytest.approx(0.8)}
    assert found["friction_ratio"] == pytest.approx(1 / 0.8)
    assert list(found["mae_n"].values()) == pytest.approx([0, 0, 0.2 * 2.3 / 3])


def test_objects_are_pressed_and_dragged_anew_for_each_seed(tiny_rig_scene, tiny_rig_cache):
    from fastac.sensor.mechanics.rig import rig_of

    rig = rig_of(tiny_rig_scene.sensor, tiny_rig_cache, progress=False)
    first, again, other = (study.presses(rig, tiny_rig_scene, "edge", 3, seed)[1] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.isclose(first, other).any()
    largest_n, friction = max(tiny_rig_scene.protocol.loads_n), tiny_rig_scene.sensor.elastomer.friction
    assert (first[:, 2] <= 1.001 * largest_n).all()
    assert (np.hypot(first[:, 0], first[:, 1]) <= 1.001 * friction * first[:, 2]).all()


def test_refuses_bundles_of_two_sensors(tiny_rig_bundle, make_scene, tmp_path):
    gel = {"mechanics": "fem", "friction": 0.7, "elements": 12, "layers": 1}
    scene = make_scene(outputs=["force_xyz"], sensor={"elastomer": gel})
    other = replace(tiny_rig_bundle, pipeline=tiny_rig_bundle.pipeline.replace(scene=scene))
    with pytest.raises(FingertipError, match="study shapes: other: sensor: expected that of first"):
        study.run({"first": tiny_rig_bundle, "other": other}, tmp_path, progress=False)


def test_the_command(tiny_rig_folder, tiny_rig_cache, tiny_folder, tmp_path):
    base = ["study", "shapes", "--store", str(tiny_rig_cache), "--no-progress", "-o", str(tmp_path / "s")]
    output = succeed(*base, "--objects", "1", str(tiny_rig_folder)).output
    assert "1 new objects of each kind" in output
    assert f"written: {tmp_path / 's'}/shapes.json" in output
    assert "study shapes: outputs = normals, depth, force_z: expected" in fail(*base, str(tiny_folder))
