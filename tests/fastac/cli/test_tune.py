"""`fastac tune` on a small simulated recording: a scene that trains, figures that repeat, one-line errors."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.scenes import schema as scenes
from fastac.sensor import dataset

SCENE = """\
outputs = ["normals"]
[sensor]
geometry = "fingertip"
source = "recorded"
height_px = 16
width_px = 16
pitch_mm = 0.25
channels = "bgr+nir"
ellipsoid = { semi_axes_mm = [4.0, 5.0, 3.0] }
[poisson]
mode = "absolute"
[training]
normals_epochs = 2
finetune_epochs = 1
"""


def run(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments], prog_name="fastac")
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "recorded.toml"
    path.write_text(SCENE)
    return path


def tune(scene_file, data, output, *more, code=0):
    store = scene_file.parent / "store"
    few = ("--candidates", 3, "--folds", 3, "--seeds", 1, "--vary", "training.normals_epochs=1,2,3")
    only = [w for key in ("input_noise", "position_noise", "teachers") for w in ("--keep", f"training.{key}")]
    given = (*few, *only, "--store", store, "--jobs", 1, "-o", output, "--no-progress", *more)
    return run("tune", scene_file, "--data", data, *given, code=code)


def test_a_recording_becomes_a_scene(scene_file, tiny_file, tmp_path):
    out = tune(scene_file, tiny_file, tmp_path / "tuned")
    assert "Nested errors: on folds that had no say in the choice" in out
    assert "Test: presses that were looked at once, now" in out
    found = scenes.load(tmp_path / "tuned" / "tuned.toml")
    chosen = {"level_light": found.sensor.level_light}  # may have been chosen
    assert found.sensor == scenes.load(scene_file).sensor.model_copy(update=chosen)
    content = json.loads((tmp_path / "tuned" / "tune.json").read_text())
    assert len(content["candidates"]) == 3
    assert content["metrics"] == ["normal_mae_deg"]
    assert sum(map(len, content["folds"])) == 13  # places of the splits train and validation
    assert "<svg" in (tmp_path / "tuned" / "tune.html").read_text()
    # Everything is kept: a second run trains nothing and finds the same.
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "store").rglob("*.npz")}
    again = tune(scene_file, tiny_file, tmp_path / "again")
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "store").rglob("*.npz")} == before
    assert json.loads((tmp_path / "again" / "tune.json").read_text()) == content
    assert again.replace("again", "tuned") == out
    assert "exists already" in tune(scene_file, tiny_file, tmp_path / "again", code=1)


def test_what_cannot_be_tuned(scene_file, tiny_file, tmp_path, tiny_data):
    assert "--metric speed: expected one of" in tune(
        scene_file, tiny_file, tmp_path / "o", "--metric", "speed", code=1
    )
    one = np.where(np.arange(len(tiny_data)) < 2, "train", "test")
    kept = ("pitch_mm", "channels", "source", "background", "frames", "normals", "rest_depth_mm")
    given = {name: getattr(tiny_data, name) for name in kept}
    dataset.write(tmp_path / "two.h5", split=one, **given)
    out = tune(scene_file, tmp_path / "two.h5", tmp_path / "o", code=1)
    assert f"{tmp_path / 'two.h5'}: 2 groups or presses outside of the split test: expected 3 or more" in out
    assert not (tmp_path / "o").exists()
