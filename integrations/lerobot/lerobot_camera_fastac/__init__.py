"""FasTac sensors for LeRobot: found by this package's name, read from the stream of `fastac serve`."""

from .config_fastac_camera import FastacCameraConfig
from .config_fastac_touch import FastacTouchConfig
from .fastac_camera import FastacCamera
from .fastac_touch import FastacTouch

__all__ = ["FastacCamera", "FastacCameraConfig", "FastacTouch", "FastacTouchConfig"]
