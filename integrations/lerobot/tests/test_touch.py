"""A robot with FasTac fingertips: the arm's observations and actions, and touch beside these."""

import draccus
import pytest
import stand_in_arm  # noqa: F401 - registers the arm
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot_camera_fastac import FastacTouchConfig
from stand_in import SIZE


@pytest.fixture
def make(serve, tmp_path):
    """`make(force_axes=["z"], …)`: a robot with one fingertip, and the stand-in that this will connect to."""

    def make(about: dict | None = None, arm: dict | None = None, tip: dict | None = None, **changes):
        stream = serve(**(about or {}))
        fingertip = {"type": "fastac", "address": stream.address, "width": SIZE, "height": SIZE, "fps": 30}
        content = {
            "type": "fastac_touch",
            "calibration_dir": str(tmp_path),
            "arm": {"type": "stand_in_arm", "calibration_dir": str(tmp_path), **(arm or {})},
            "fingertips": {"tip": {**fingertip, "grid": [1, 2], **(tip or {})}},
            **changes,
        }
        return make_robot_from_config(draccus.decode(RobotConfig, content)), stream

    return make


def test_observations_have_what_the_features_say(make):
    robot, stream = make(force_axes=["x", "z"], point_columns=["dz", "Fz"])
    robot.connect()
    try:
        stream.pressed_mm = 1.5
        while (observed := robot.get_observation())["tip.Fz"] != 1.5:
            pass
        robot.send_action({"joint.pos": 3.0})
        assert robot.get_observation()["joint.pos"] == 3.0
    finally:
        robot.disconnect()
    image = observed.pop("tip")
    assert (image == [30, 20, 10]).all()
    assert observed == pytest.approx(
        {
            "joint.pos": 0.0,
            "tip.Fx": 0.375,
            "tip.Fz": 1.5,
            "tip.suspect": 1.0,
            "tip.0.dz": 1.5,
            "tip.1.dz": 1.5,
            "tip.0.Fz": 0.0015 * 62 * 31,
            "tip.1.Fz": 0.0015 * 62 * 31,
        },
        rel=1e-5,
    )
    assert robot.observation_features == {**dict.fromkeys(observed, float), "tip": (SIZE, SIZE, 3)}
    assert robot.action_features == {"joint.pos": float}
    assert list(robot.cameras) == ["tip"]


@pytest.mark.parametrize(
    ("about", "changes", "message"),
    [
        ({"force_axes": ["z"]}, {"force_axes": ["x", "z"]}, "tip: force_axes: x: the stream finds z"),
        ({"force_axes": []}, {}, "tip: force_axes: z: the stream finds no force"),
        ({}, {"point_columns": ["dx", "dz"]}, "tip: point_columns: dx: the stream does not find these"),
    ],
)
def test_a_stream_that_does_not_find_what_is_recorded_is_refused(make, about, changes, message):
    robot, _ = make(about, **changes)
    with pytest.raises(ConnectionError, match=message):
        robot.connect()
    assert not any(tip.is_connected for tip in robot.fingertips.values())


def test_fingertips_are_released_where_the_arm_fails(make):
    robot, _ = make(arm={"fails": True})
    with pytest.raises(ConnectionError, match="the arm is not there"):
        robot.connect()
    assert not robot.fingertips["tip"].is_connected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fingertips": {}}, "fingertips: expected one or more"),
        ({"force_axes": ["w"]}, "force_axes: 'w': expected some of x, y, z"),
        ({"point_columns": ["Mz"]}, "point_columns: 'Mz': expected some of dx, dy, dz, Fx, Fy, Fz"),
    ],
)
def test_a_wrong_value_is_named(make, changes, message):
    robot, _ = make()
    fingertips = robot.config.fingertips
    with pytest.raises(ValueError, match=message):
        FastacTouchConfig(**{"arm": {}, "fingertips": fingertips, **changes})


def test_a_fingertip_has_sizes_and_is_a_fastac_sensor(make):
    robot, _ = make()
    tip = robot.config.fingertips["tip"]
    tip.width = None
    with pytest.raises(ValueError, match="fingertips: tip: width: missing"):
        FastacTouchConfig(arm={}, fingertips={"tip": tip})
