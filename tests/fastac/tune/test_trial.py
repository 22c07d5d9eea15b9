"""What is left out has no influence; what is asked for is judged."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.sensor import dataset
from fastac.tune import trial
from fastac.tune.groups import names_of, units_of
from fastac.tune.trial import METRICS, Source, perform, step_of, without


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(outputs=["normals", "depth"], training={"normals_epochs": 1, "finetune_epochs": 1})


@pytest.fixture
def source(tiny_file, tmp_path):
    return Source(tiny_file, tmp_path / "store", None, False)


def test_the_test_split_stays_aside(source, scene, tiny_data):
    known, units = without(source, scene, [])
    assert set(units[tiny_data.split == "test"]) == {""}
    assert not len(known.indices("test"))
    assert np.array_equal(known.split[units != ""], tiny_data.split[units != ""])
    folded, units = without(replace(source, with_test=True), scene, [])
    assert "" not in units
    assert len(folded.indices("train")) == (tiny_data.split != "validation").sum()


def test_what_is_held_out_has_no_influence(source, scene, tiny_data, tmp_path):
    """Other frames and labels in the held-out units and in the split test leave the network as it is."""
    held_out = names_of(units_of(tiny_data)[tiny_data.split == "train"])[:2]
    _, units = without(source, scene, held_out)
    changed = np.isin(units, held_out) | (tiny_data.split == "test")
    frames, normals = tiny_data.frames.copy(), tiny_data.normals.copy()
    frames[changed] = 255 - frames[changed]
    normals[changed] = (0, 0, 1)
    kept = ("pitch_mm", "channels", "source", "background", "split", "depth_mm", "force_n", "indenter")
    given = {name: getattr(tiny_data, name) for name in (*kept, "rest_depth_mm")}
    dataset.write(tmp_path / "other.h5", frames=frames, normals=normals, **given)
    found = []
    for file in (source.data, tmp_path / "other.h5"):
        folder = tmp_path / file.stem
        folder.mkdir()
        settings = {"data": file, "store": source.store, "by": None, "with_test": False}
        trial.network(folder, scene, held_out, **settings)
        found.append(dict(np.load(folder / trial.NORMALS)))
    assert found[0].keys() == found[1].keys()
    assert all(np.array_equal(found[0][name], found[1][name]) for name in found[0])


def test_errors_by_unit(source, scene, tiny_data):
    held_out = names_of(units_of(tiny_data)[tiny_data.split == "train"])[:2]
    found = perform(scene.model_dump(mode="json"), source, held_out)
    assert list(found) == held_out
    assert all(list(errors) == ["normal_mae_deg", "depth_mae_mm"] for errors in found.values())
    whole = perform(scene.model_dump(mode="json"), source, None)
    assert set(whole) == {"float", "integer"}
    assert set(whole["integer"]) <= set(METRICS)


def test_forces_are_fitted_without_what_is_held_out(source, tiny_data, make_scene):
    scene = make_scene(
        outputs=["force_z"], training={"normals_epochs": 1, "force_epochs": 1}, force={"hidden": 4}
    )
    held_out = names_of(units_of(tiny_data)[tiny_data.split == "train"])[:2]
    found = perform(scene.model_dump(mode="json"), source, held_out)
    assert all(list(errors) == ["force_mae_n"] for errors in found.values())


def test_the_store_is_no_part_of_a_step(source, scene, tmp_path):
    moved = replace(source, store=tmp_path / "elsewhere")
    assert step_of(scene, source, ["a"]).arguments.keys() == step_of(scene, moved, ["a"]).arguments.keys()
    assert step_of(scene, moved, None).unkeyed == {"store": moved.store}
