"""Random objects are pressed, learned from, calibrated on and counted."""

import json

import numpy as np
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.sensor import dataset
from fastac.studies.robustness import random_objects
from fastac.studies.robustness.coverage import scene_of


def test_the_command(tmp_path):
    folder = tmp_path / "coverage"
    arguments = ["study", "coverage", "--objects", "5", "4", "5", "--coverage", "0.75", "-o", str(folder)]
    found = CliRunner().invoke(main, [*arguments, "--no-progress"], catch_exceptions=False)
    assert "objects: 5 train, 4 validation, 5 test; 3 presses of each" in found.output
    assert "intervals, force_y: " in found.output
    content = json.loads((folder / "coverage.json").read_text())
    assert content["force_interval"]["coverage"] == 0.75
    assert content["force_interval"]["as_they_are"]["groups"] == 5


def test_objects_are_groups_of_presses(tmp_path):
    scene = scene_of(0.9, ("force_z",))
    random_objects.write(tmp_path, scene, {"train": 5, "test": 1}, 2, 3)
    data = dataset.read(tmp_path / "data.h5", scene)
    assert data.split.tolist() == ["train"] * 10 + ["test"] * 2
    assert data.group.tolist()[:4] == ["train ball 0"] * 2 + ["train cylinder 1"] * 2
    assert len(set(data.group)) == 6
    low, high = random_objects.LOADS_N
    assert ((data.force_n[:, 2] > low) & (data.force_n[:, 2] < high)).all()
    assert len(np.unique(data.force_n[:, 2])) == 12
