"""What LeRobot's configuration says of an arm with FasTac fingertips: `--robot.type=fastac_touch`."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.cameras.configs import CameraConfig
from lerobot.robots.config import RobotConfig

from .config_fastac_camera import FastacCameraConfig
from .taxels import AXES, POINT_COLUMNS


@RobotConfig.register_subclass("fastac_touch")
@dataclass(kw_only=True)
class FastacTouchConfig(RobotConfig):
    """Any robot of LeRobot, with fingertips whose force is part of the observed state.

    arm : the robot's own configuration, such as `{type: so101_follower, port: /dev/ttyACM0}`
    fingertips : FasTac cameras by name; each with `width`, `height` and `fps`, as LeRobot's cameras in robots
    force_axes : axes of the force that are recorded; the sensors must find them
    point_columns : which of dx, dy, dz, Fx, Fy, Fz of each taxel are recorded in the state, beside the force
    """

    arm: dict[str, Any]
    fingertips: dict[str, CameraConfig] = field(default_factory=dict)
    force_axes: tuple[str, ...] = ("z",)
    point_columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.fingertips:
            raise ValueError("fingertips: expected one or more, such as {tip: {type: fastac, …}}")
        for name, config in self.fingertips.items():
            if not isinstance(config, FastacCameraConfig):
                raise ValueError(f"fingertips: {name}: type = {config.type!r}: expected 'fastac'")
            missing = [key for key in ("width", "height", "fps") if getattr(config, key) is None]
            if missing:
                raise ValueError(f"fingertips: {name}: {', '.join(missing)}: missing")
        for key, known in (("force_axes", AXES), ("point_columns", POINT_COLUMNS)):
            wrong = [one for one in getattr(self, key) if one not in known]
            if wrong:
                raise ValueError(f"{key}: {wrong[0]!r}: expected some of {', '.join(known)}")
