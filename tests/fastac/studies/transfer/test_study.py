"""Second units of the tiny sensor: presses that are taken, errors by way and number, a study that goes on."""

import json

import numpy as np
import pytest

from fastac.sensor import dataset
from fastac.studies.transfer import shown, study
from fastac.studies.transfer.study import ANEW, AS_IS, WAYS, anew, few


def test_fewer_presses_are_a_part_of_more(tiny_file, tiny_data, tmp_path):
    taken = {}
    for count in (1, 3, 13):
        few(tiny_file, tiny_data, count, 1, tmp_path / "few.h5")
        found = dataset.read(tmp_path / "few.h5")
        taken[count] = set(found.indices("train").tolist())
        assert len(taken[count]) == 2 * count  # two loads at each place
        assert np.array_equal(found.frames, tiny_data.frames)
        assert not taken[count] & set(tiny_data.indices("test").tolist())
    assert taken[1] < taken[3] < taken[13]
    with pytest.raises(ValueError, match=r"^presses = 14: expected at most 13"):
        few(tiny_file, tiny_data, 14, 1, tmp_path / "few.h5")


def test_steps_of_a_training_anew(tiny_scene):
    own = tiny_scene.training
    assert anew(tiny_scene, 1.0) == tiny_scene
    assert anew(tiny_scene, 0.25).training.normals_epochs == 4 * own.normals_epochs
    assert anew(tiny_scene, 0.001).training.force_epochs == study.MOST_EPOCHS * own.force_epochs


@pytest.mark.full
def test_study(make_scene, tmp_path):
    scene = make_scene(
        hardware={"weights": "loadable"},
        training={"normals_epochs": 2, "finetune_epochs": 1, "force_epochs": 2},
        force={"hidden": 4},
    )
    keys = {"units": 1, "counts": (1, 3), "progress": False}
    content = json.loads(json.dumps(study.run(scene, tmp_path / "transfer", **keys)))
    found = content["errors"]["1"]
    assert list(found) == list(WAYS)
    assert found[AS_IS]["0"].keys() == set(study.METRICS)
    assert all(set(found[way]) == {"1", "3"} for way in ("gains", "last", "all", "adapt chooses"))
    assert set(found[ANEW]) == {"3"}
    [reason] = content["left_out"]  # one place has two frames: too few to hold any out
    assert reason.startswith("unit 1, 1 presses, trained anew: ")
    assert json.loads((tmp_path / "transfer" / "transfer.json").read_text()) == content
    text = shown.tables(content)[0].text
    assert "trained anew" in text
    shown.write(content, tmp_path / "transfer.png")
    assert (tmp_path / "transfer.png").stat().st_size
    assert json.loads(json.dumps(study.run(scene, tmp_path / "transfer", **keys))) == content
