"""What a dataset lacks for training on whole frames is named."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.training import TrainingError, require
from fastac.models.training.whole_frames.usable_frames import unknown_depth


@pytest.mark.parametrize(
    ("changes", "lack"),
    [
        ({"depth_mm": None}, "depth_mm: missing, and training.depth_weight needs"),
        ({"valid": False}, "valid: not every pixel is, and training.depth_weight needs"),
    ],
)
def test_unknown_depth_is_refused(tiny_data, make_scene, tmp_path, changes, lack):
    if "valid" in changes:
        changes = {"valid": np.ones(tiny_data.frames.shape[:3], bool)}
        changes["valid"][3, 5, 7] = False
    scene, path = make_scene(training={"depth_weight": 1.0}), tmp_path / "frames.h5"
    require(tiny_data, scene, path)
    with pytest.raises(TrainingError, match=f"frames.h5: {lack}"):
        require(replace(tiny_data, **changes), scene, path)


def test_contact_circles_of_balls_are_enough(pressed):
    assert unknown_depth(pressed) is None
    without = {name: values for name, values in pressed.indenter.items() if name != "ball_mm"}
    assert unknown_depth(replace(pressed, indenter=without)).startswith("depth_mm: missing")
    nowhere = pressed.indenter | {"radius_px": np.full(len(pressed), np.nan)}
    assert unknown_depth(replace(pressed, indenter=nowhere)).startswith("depth_mm: missing")
