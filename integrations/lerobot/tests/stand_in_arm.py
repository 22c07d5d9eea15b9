"""An arm and its leader that are no hardware: one joint, at the angle that it was sent last."""

from dataclasses import dataclass

from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig


class Device:
    """What robots and teleoperators of LeRobot have in common."""

    is_calibrated = True
    is_connected = False
    action_features = {"joint.pos": float}  # noqa: RUF012

    def __init__(self, config):
        super().__init__(config)
        self.config = config

    def connect(self, calibrate: bool = True) -> None:
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...


@RobotConfig.register_subclass("stand_in_arm")
@dataclass(kw_only=True)
class StandInArmConfig(RobotConfig):
    fails: bool = False


class StandInArm(Device, Robot):
    config_class = StandInArmConfig
    name = "stand_in_arm"
    observation_features = {"joint.pos": float}  # noqa: RUF012
    angle = 0.0

    def connect(self, calibrate: bool = True) -> None:
        if self.config.fails:
            raise ConnectionError("the arm is not there")
        super().connect(calibrate)

    def get_observation(self) -> dict:
        return {"joint.pos": self.angle}

    def send_action(self, action: dict) -> dict:
        self.angle = action["joint.pos"]
        return action


@TeleoperatorConfig.register_subclass("stand_in_leader")
@dataclass(kw_only=True)
class StandInLeaderConfig(TeleoperatorConfig): ...


class StandInLeader(Device, Teleoperator):
    config_class = StandInLeaderConfig
    name = "stand_in_leader"
    feedback_features = {}  # noqa: RUF012

    def get_action(self) -> dict:
        return {"joint.pos": 12.5}

    def send_feedback(self, feedback: dict) -> None: ...
