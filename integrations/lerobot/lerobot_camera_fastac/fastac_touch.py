"""Any LeRobot robot with FasTac fingertips, so that `lerobot-record` keeps force and points with its state.

LeRobot 0.4.4 records numbers of a robot's state and images of cameras, and no other arrays: a camera alone
adds an image. This robot passes everything on to the robot it wraps, and adds to its observations the image
and the numbers of each fingertip:

    tip                  (H, W, 3) uint8
    tip.Fx tip.Fy tip.Fz N, those of `force_axes`
    tip.suspect          1.0 where the record is flagged bad or suspect, else 0.0
    tip.17.dz            column dz of taxel 17, for each of `point_columns`
"""

from functools import cached_property

import draccus
import numpy as np
from lerobot.robots import Robot, RobotConfig, make_robot_from_config
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from .config_fastac_touch import FastacTouchConfig
from .fastac_camera import FastacCamera
from .taxels import AXES, POINT_COLUMNS


class FastacTouch(Robot):
    """A robot of LeRobot whose observations have touch beside what its arm observes."""

    config_class = FastacTouchConfig
    name = "fastac_touch"

    def __init__(self, config: FastacTouchConfig):
        super().__init__(config)
        self.config = config
        self.arm = make_robot_from_config(draccus.decode(RobotConfig, config.arm))
        self.fingertips = {name: FastacCamera(one) for name, one in config.fingertips.items()}
        taken = set(self.arm.observation_features) & set(self._touch_features)
        if taken:
            raise ValueError(f"fingertips: {sorted(taken)[0]}: the arm observes something of that name")

    @property
    def cameras(self) -> dict:
        """The arm's cameras and the fingertips: LeRobot counts them for its image writers."""
        return {**getattr(self.arm, "cameras", {}), **self.fingertips}

    @cached_property
    def observation_features(self) -> dict[str, type | tuple]:
        return {**self.arm.observation_features, **self._touch_features}

    @cached_property
    def action_features(self) -> dict[str, type]:
        return self.arm.action_features

    @cached_property
    def _touch_features(self) -> dict[str, type | tuple]:
        features: dict[str, type | tuple] = {}
        for name, config in self.config.fingertips.items():
            taxels = config.grid[0] * config.grid[1]
            features |= {f"{name}.F{axis}": float for axis in self.config.force_axes}
            features[f"{name}.suspect"] = float
            features |= {
                f"{name}.{k}.{column}": float for k in range(taxels) for column in self.config.point_columns
            }
            features[name] = (config.height, config.width, 3)
        return features

    @property
    def is_connected(self) -> bool:
        return self.arm.is_connected and all(tip.is_connected for tip in self.fingertips.values())

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connect the fingertips, which must be untouched, then the arm.

        Raises ConnectionError where a stream does not find what is to be recorded.
        """
        try:
            for name, tip in self.fingertips.items():
                tip.connect()
                self._require(name, tip)
            self.arm.connect(calibrate)
        except Exception:
            self._release()
            raise

    @property
    def is_calibrated(self) -> bool:
        return self.arm.is_calibrated

    def calibrate(self) -> None:
        self.arm.calibrate()

    def configure(self) -> None:
        self.arm.configure()

    @check_if_not_connected
    def get_observation(self) -> dict:
        """What the arm observes, and of each fingertip the newest record."""
        observed = self.arm.get_observation()
        for name, tip in self.fingertips.items():
            image = tip.read_latest()
            touch = tip.tactile()
            force_n = dict(zip(AXES, touch["wrench"][:3].tolist(), strict=True))
            observed |= {f"{name}.F{axis}": force_n[axis] for axis in self.config.force_axes}
            observed[f"{name}.suspect"] = float(tip.record.suspect or tip.record.bad)
            for column in self.config.point_columns:
                values = touch["points"][:, POINT_COLUMNS.index(column)].tolist()
                observed |= {f"{name}.{k}.{column}": value for k, value in enumerate(values)}
            observed[name] = image
        return observed

    @check_if_not_connected
    def send_action(self, action: dict) -> dict:
        return self.arm.send_action(action)

    @check_if_not_connected
    def disconnect(self) -> None:
        self._release()
        self.arm.disconnect()

    def _release(self) -> None:
        for tip in self.fingertips.values():
            if tip.is_connected:
                tip.disconnect()

    def _require(self, name: str, tip: FastacCamera) -> None:
        """The stream finds every number that is recorded: none of them would be NaN in all records."""
        absent = [axis for axis in self.config.force_axes if axis not in tip.about.force_axes]
        if absent:
            found = ", ".join(tip.about.force_axes) or "no force"
            raise ConnectionError(f"{name}: force_axes: {', '.join(absent)}: the stream finds {found}")
        points = tip.taxels.points(tip.record, tip.rest_mm)
        unknown = [c for c in self.config.point_columns if np.isnan(points[:, POINT_COLUMNS.index(c)]).all()]
        if unknown:
            raise ConnectionError(
                f"{name}: point_columns: {', '.join(unknown)}: the stream does not find these"
            )
