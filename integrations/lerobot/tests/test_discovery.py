"""LeRobot finds the package by its name, and makes its devices from their configurations."""

import subprocess
import sys

import draccus
import pytest
from lerobot.cameras.configs import CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot_camera_fastac import FastacCamera, FastacCameraConfig

FIND = """
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot.cameras.configs import CameraConfig
from lerobot.robots.config import RobotConfig
assert "fastac" not in CameraConfig.get_known_choices()
register_third_party_plugins()
print(CameraConfig.get_choice_class("fastac").__module__)
print(RobotConfig.get_choice_class("fastac_touch").__module__)
"""


def test_lerobot_discovers_camera_and_robot():
    found = subprocess.run([sys.executable, "-c", FIND], capture_output=True, text=True, check=True).stdout
    assert found.split() == [
        "lerobot_camera_fastac.config_fastac_camera",
        "lerobot_camera_fastac.config_fastac_touch",
    ]


def test_lerobots_factory_makes_the_camera_of_a_configuration():
    content = {"type": "fastac", "address": "tcp://127.0.0.1:1", "grid": [4, 8], "fps": 30}
    cameras = make_cameras_from_configs({"tip": draccus.decode(CameraConfig, content)})
    assert type(cameras["tip"]) is FastacCamera
    assert (cameras["tip"].config.grid, cameras["tip"].fps) == ((4, 8), 30)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"content": "sound"}, "content = 'sound': expected one of image, nir, depth"),
        ({"unknown": "one"}, "unknown = 'one': expected one of nan, zero"),
        ({"depth_range_mm": [1, 1]}, r"depth_range_mm = \[1, 1\]: expected the smaller number first"),
        ({"grid": [0, 4]}, r"grid = \[0, 4\]: expected numbers above 0"),
        ({"tare_frames": -1}, "tare_frames = -1: expected 0 or more"),
        ({"timeout_s": 0}, "timeout_s = 0: expected a number above 0"),
    ],
)
def test_a_wrong_value_is_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        FastacCameraConfig(**wrong)
