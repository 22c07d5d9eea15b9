"""How a FasTac sensor is configured in LeRobot: `{type: fastac, width: 128, height: 128, fps: 30}`."""

from dataclasses import dataclass

from lerobot.cameras.configs import CameraConfig, ColorMode

CONTENTS = ("image", "nir", "depth")
UNKNOWN = ("nan", "zero")


@CameraConfig.register_subclass("fastac")
@dataclass(kw_only=True)
class FastacCameraConfig(CameraConfig):
    """A FasTac sensor as a camera of LeRobot.

    address : where `fastac serve` publishes
    content : what an image shows: "image" the colours that the sensor saw, "nir" its near-infrared channel in
        all three channels, "depth" how deep the skin is pressed in, from black to white
    color_mode : order of an image's channels, "rgb" or "bgr"
    depth_range_mm : indentation that is shown black, and that which is shown white
    grid : rows and columns of taxels
    tare_frames : records of the untouched skin, taken when connecting, whose mean is the depth at rest;
        0: none, and `FastacCamera.tare` must be called before there are displacements
    unknown : what stands in points and wrench for what the stream does not find, "nan" or "zero"
    timeout_s : how long to wait for the stream, and in `read` for a record

    width, height : of the images; where they are given the sensor must have them. LeRobot demands them of a
        camera in a robot. A depth image is two rows and two columns smaller than the sensor's frame.
    """

    address: str = "tcp://127.0.0.1:5599"
    content: str = "image"
    color_mode: ColorMode = ColorMode.RGB
    depth_range_mm: tuple[float, float] = (0.0, 1.0)
    grid: tuple[int, int] = (16, 16)
    tare_frames: int = 10
    unknown: str = "nan"
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        self.color_mode = ColorMode(self.color_mode)
        for name, known in (("content", CONTENTS), ("unknown", UNKNOWN)):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} = {getattr(self, name)!r}: expected one of {', '.join(known)}")
        low, high = self.depth_range_mm
        if not low < high:
            raise ValueError(f"depth_range_mm = {[low, high]}: expected the smaller number first")
        if not all(parts > 0 for parts in self.grid):
            raise ValueError(f"grid = {list(self.grid)}: expected numbers above 0")
        if self.tare_frames < 0:
            raise ValueError(f"tare_frames = {self.tare_frames}: expected 0 or more")
        if not self.timeout_s > 0:
            raise ValueError(f"timeout_s = {self.timeout_s}: expected a number above 0")
