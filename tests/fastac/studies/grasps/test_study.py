import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.flow.leave_one_out import MODELS
from fastac.scenes import schema
from fastac.sensor import dataset
from fastac.sensor.protocol import FingertipError
from fastac.studies.grasps import recordings, study

OBJECTS = ["ball of 7 mm", "edge", "three bumps"]


@pytest.fixture(scope="module")
def scene():
    return schema.load("scenes/grasp.toml")


def test_recordings_differ_by_object_press_and_light(scene, tmp_path):
    known = recordings.virtual(scene)
    recordings.write(tmp_path, known, OBJECTS, 2, 1)
    data = dataset.read(tmp_path / recordings.RECORDINGS, known)
    assert list(dict.fromkeys(data.group.tolist())) == OBJECTS
    for name in OBJECTS:
        force_n, frames = data.force_n[data.group == name, 2], data.frames[data.group == name].astype(float)
        rests = force_n == 0
        assert (rests.sum(), len(rests)) == (recordings.REST_FRAMES, recordings.REST_FRAMES + 16)
        first = force_n[~rests][: recordings.STEPS]
        assert (np.diff(first) > 0).all()
        assert force_n.max() <= recordings.LOADS_N[1] * 1.001
        moved = np.abs(frames - data.background).mean(axis=(1, 2, 3))
        assert moved[~rests][7] > moved[~rests][0]
    at_rest = data.frames[data.force_n[:, 2] == 0].reshape(3, -1, data.frames[0].size).mean(axis=(1, 2))
    assert np.ptp(at_rest) / at_rest.mean() > 1e-3, "each recording has a light of its own"


def test_bumps_are_side_by_side():
    height = recordings.OBJECTS["four bumps"].height_mm
    middle = len(height) // 2
    assert height.min() < 0.02 < height[middle, middle]


def test_one_thing_changes_from_way_to_way(scene):
    recorded, levelled, unmirrored, free = study.scenes(scene).values()
    assert recorded == scene
    assert (levelled.sensor.level_light, levelled.training) == (True, scene.training)
    for changed, keys in ((unmirrored, {"press_symmetry": False}), (free, study.WITHOUT)):
        assert changed == scene.model_copy(update={"training": scene.training.model_copy(update=keys)})
    assert study.WITHOUT.keys() == {"press_symmetry", "curl_weight"}
    assert not any(study.WITHOUT.values())


def test_ways_by_name():
    assert study.named([]) == list(study.WAYS)
    assert study.named(["levelled", "as recorded"]) == ["as recorded", "levelled"]
    with pytest.raises(ValueError, match="--way 'no': expected one of 'as recorded', 'levelled', "):
        study.named(["no"])


@pytest.mark.full
def test_each_object_is_left_out(scene, tmp_path):
    short = {"normals_epochs": 1, "force_epochs": 1, "finetune_epochs": 1, "force_batch": 32}
    brief = scene.model_copy(update={"training": scene.training.model_copy(update=short)})
    objects = OBJECTS[:2]
    settings = {"objects": objects, "presses": 1, "jobs": 1, "store": tmp_path / "store", "progress": False}
    content = study.measure(brief, tmp_path / "out", **settings)
    assert (tmp_path / "out" / study.FILE).is_file()
    assert list(content["ways"]) == list(study.WAYS)
    groups, levelled, unmirrored, free = (run["groups"] for [run] in content["ways"].values())
    assert list(groups) == list(levelled) == list(unmirrored) == list(free) == objects
    assert groups["edge"]["mae_n"] != levelled["edge"]["mae_n"]
    assert groups["edge"]["mae_n"]["linear"] == free["edge"]["mae_n"]["linear"]
    assert any(unmirrored[name]["mae_n"]["float"] != free[name]["mae_n"]["float"] for name in objects)
    [alone] = study.measure(brief, tmp_path / "one", ways=["levelled"], **settings)["ways"].items()
    assert alone == ("levelled", content["ways"]["levelled"])
    first, second, *others = study.tables(content)
    assert [row[0] for row in first.rows] == [*objects, "mean"]
    found = [groups[name]["mae_n"]["linear"] for name in objects]
    assert float(first.rows[-1][2 + MODELS.index("linear")]) == pytest.approx(np.mean(found), abs=6e-4)
    assert "levelled" in second.title
    parts = [table.title.split("without ")[1] for table in others]
    assert parts == [" and ".join(list(study.WITHOUT)[:k]) for k in (1, 2)]


def test_a_scene_that_does_not_learn_from_forces():
    with pytest.raises(FingertipError, match=r"^gelsight: expected a flat gel and training.labels 'force'"):
        recordings.virtual(schema.load("scenes/gelsight.toml"))


def test_command_says_what_is_wrong(tmp_path):
    result = CliRunner().invoke(main, ["study", "grasps", "scenes/paper.toml", "-o", str(tmp_path)])
    assert result.exit_code == 1
    assert "training.labels 'force'" in result.stderr
    unknown = CliRunner().invoke(main, ["study", "grasps", "scenes/grasp.toml", "--way", "no"])
    assert (unknown.exit_code, unknown.stderr.count("\n")) == (1, 1)
