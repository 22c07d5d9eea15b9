"""Labels rendered from a pose equal the finite-element gel's ground truth wherever they are valid."""

import dataclasses

import numpy as np
import pytest

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.importers.cad import of_scene
from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.pose_labels import labels
from fastac.sensor.importers.poses import Pose
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.protocol import Station

SENSOR = Sensor(
    geometry="fingertip",
    height_px=64,
    width_px=64,
    pitch_mm=0.25,
    elastomer={"mechanics": "fem", "friction": 0.8, "elements": 24, "layers": 2},
)
CAD = of_scene(SENSOR)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    return FemRig(SENSOR, tmp_path_factory.mktemp("cache"), progress=False)


def pose(**changes):
    return dataclasses.replace(Pose("train", 0, 0.0, 0.0, 4.3, 1.0, 0.0, 0.0), **changes)


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (3.0, -2.0), (-4.0, 4.0)])
@pytest.mark.parametrize("load", [1.0, 1.5])
def test_they_are_the_gel_s_own_truth(rig, x, y, load):
    (pressed,) = rig.presses(Station("train", x, y, load, 5.0))
    known = Pose("train", 0, *(pressed.pose[f"{k}_mm"] for k in "xyz"), load, 0.0, 0.0)
    normals, depth, valid = labels(CAD, known, 5.0, "here")
    assert valid.sum() > 0.4 * pressed.in_contact.sum()
    assert not (valid & ~pressed.in_contact).any()
    np.testing.assert_allclose(depth[valid], pressed.depth_mm[valid], atol=1e-9)
    np.testing.assert_allclose(normals[valid], pressed.normals[valid], atol=1e-9)
    assert np.isnan(depth[~valid]).all()


def test_geometry_is_of_vertical_samples_only():
    _, depth, valid = labels(CAD, pose(tangential_x_n=0.3), 5.0, "here")
    assert not valid.any()
    assert np.isnan(depth).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x_mm": 9.0}, "here: x_mm = 9: outside the skin"),
        ({"y_mm": -8.0}, "here: y_mm = -8: outside the skin"),
        ({"z_mm": 9.0}, r"here: z_mm = 9: the ball is .* mm above the skin"),
        ({"z_mm": 0.1}, r"here: z_mm = 0\.1: sinks .* mm into 3 mm of elastomer"),
    ],
)
def test_refuses_what_no_gel_could_carry(changes, message):
    with pytest.raises(ImportFailure, match=message):
        labels(CAD, pose(**changes), 5.0, "here")
