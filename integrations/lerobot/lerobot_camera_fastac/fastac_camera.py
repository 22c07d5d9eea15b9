"""A FasTac sensor as a LeRobot camera, which also gives points and a wrench.

camera = FastacCamera(FastacCameraConfig(address="tcp://127.0.0.1:5599"))
with camera:                         # the skin must be untouched: its depth at rest is taken
    image = camera.async_read()      # (H, W, 3) uint8
    touch = camera.tactile()         # of the same record: touch["points"] (256, 6), touch["wrench"] (6,)
"""

import time
from typing import Any

import numpy as np
from lerobot.cameras.camera import Camera
from lerobot.cameras.configs import ColorMode
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from .config_fastac_camera import FastacCameraConfig
from .messages import About, Record
from .subscription import Newest, Subscription
from .taxels import Taxels, wrench

NEEDED = {"image": "image", "nir": "image", "depth": "depth_mm"}
"""The array of a record that an image's content is made of."""


class FastacCamera(Camera):
    """The newest record of a FasTac stream, as an image and as touch.

    `read`, `async_read` and `read_latest` give an image and remember its record; `record` and `tactile` are
    of that record, so that image, points and wrench are of one frame.
    """

    def __init__(self, config: FastacCameraConfig):
        super().__init__(config)
        self.config = config
        self.rest_mm: np.ndarray | None = None
        self._stream: Subscription | None = None
        self._taxels: Taxels | None = None
        self._last: Newest | None = None

    def __str__(self) -> str:
        return f"FastacCamera({self.config.address}, {self.config.content})"

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Streams are not searched for: they are named by their address."""
        raise NotImplementedError("FasTac sensors are not searched for: give the address of `fastac serve`.")

    @property
    def is_connected(self) -> bool:
        return self._stream is not None

    @check_if_already_connected
    def connect(self, warmup: bool = True) -> None:
        """Subscribe, compare the stream with the configuration, and take the skin's depth at rest.

        warmup : wait for the first record; implied by `tare_frames` above 0
        Raises ConnectionError, one line, where there is no stream or it is of another sensor.
        """
        self._stream = Subscription(self.config.address)
        try:
            self._fit(self._stream.description(self.config.timeout_s))
            if self.config.tare_frames and "depth_mm" in self.about.arrays:
                self.tare(self.config.tare_frames)
            elif warmup:
                self._next(self.config.timeout_s)
        except (ConnectionError, TimeoutError, ValueError) as error:
            self.disconnect()
            raise ConnectionError(f"{self}: {error}") from None

    @check_if_not_connected
    def disconnect(self) -> None:
        stream, self._stream = self._stream, None
        self._last = self._taxels = self.rest_mm = None
        stream.close()

    @property
    @check_if_not_connected
    def about(self) -> About:
        """What the stream says of itself."""
        return self._stream.description(self.config.timeout_s)

    @check_if_not_connected
    def tare(self, frames: int = 10) -> None:
        """Take the mean depth of the next records as that of the untouched skin.

        Raises ValueError where the stream has no depth, TimeoutError or ConnectionError without records.
        """
        if frames < 1:
            raise ValueError(f"frames = {frames}: expected a number above 0")
        if "depth_mm" not in self.about.arrays:
            raise ValueError("tare: the stream has no depth_mm")
        depths = [self._next(self.config.timeout_s).arrays["depth_mm"] for _ in range(frames)]
        self.rest_mm = np.mean(depths, axis=0, dtype=np.float64)

    @check_if_not_connected
    def read(self) -> np.ndarray:
        """(H, W, 3) uint8: the image of the next record, which must come within `timeout_s`."""
        return self._image(self._next(self.config.timeout_s, fresh=True))

    @check_if_not_connected
    def async_read(self, timeout_ms: float = 200) -> np.ndarray:
        """(H, W, 3) uint8: the image of the newest record that was not read before; waits for one if need be.

        Raises TimeoutError where none comes in time, ConnectionError where the stream has ended.
        """
        return self._image(self._next(timeout_ms / 1000))

    @check_if_not_connected
    def read_latest(self, max_age_ms: int = 500) -> np.ndarray:
        """(H, W, 3) uint8: the image of the newest record, at once, whether or not it was read before.

        Raises TimeoutError where it came more than `max_age_ms` ago, RuntimeError where none has come.
        """
        newest = self._stream.newest()
        if newest is None:
            raise RuntimeError(f"{self}: no record has come yet")
        age_ms = 1000 * (time.monotonic() - newest.received_s)
        if age_ms > max_age_ms:
            raise TimeoutError(
                f"{self}: the newest record came {age_ms:.0f} ms ago: allowed are {max_age_ms} ms"
            )
        self._last = newest
        return self._image(newest.record)

    @property
    @check_if_not_connected
    def record(self) -> Record:
        """The record that was read last: forces, flags, slip, arrays as they were sent."""
        if self._last is None:
            raise RuntimeError(f"{self}: nothing has been read yet")
        return self._last.record

    @property
    @check_if_not_connected
    def taxels(self) -> Taxels:
        """The grid of the points: their number and where they are."""
        return self._taxels

    def tactile(self) -> dict[str, np.ndarray]:
        """Touch in the record that was read last, in the shape of LeRobot's tactile proposals.

        points : (taxels, 6) float32 [dx, dy, dz, Fx, Fy, Fz], mm and N
        wrench : (6,) float32 [Fx, Fy, Fz, Mx, My, Mz], N and N·mm
        """
        record = self.record
        found = {"points": self._taxels.points(record, self.rest_mm), "wrench": wrench(record)}
        if self.config.unknown == "zero":
            return {name: np.nan_to_num(values) for name, values in found.items()}
        return found

    def _next(self, timeout_s: float, *, fresh: bool = False) -> Record:
        """The newest record that was not read before; fresh: that comes after this call."""
        newest = self._stream.newest() if fresh else self._last
        self._last = self._stream.newer(newest.number if newest else 0, timeout_s)
        return self._last.record

    def _fit(self, about: About) -> None:
        """Compare the stream with the configuration. Raises ValueError, one line."""
        needed = NEEDED[self.config.content]
        if needed not in about.arrays:
            there = ", ".join(about.arrays) or "no arrays"
            raise ValueError(f"content = {self.config.content!r}: needs {needed}; records have {there}")
        if self.config.content == "nir" and "NIR" not in about.channels:
            raise ValueError(f"content = 'nir': the sensor's channels are {', '.join(about.channels)}")
        self._taxels = Taxels(about, self.config.grid)
        there = self._taxels.inner_px if self.config.content == "depth" else (about.height_px, about.width_px)
        for name, pixels in zip(("height", "width"), there, strict=True):
            if getattr(self.config, name) not in (None, pixels):
                raise ValueError(f"{name} = {getattr(self.config, name)}: the stream's images have {pixels}")
            setattr(self, name, pixels)

    def _image(self, record: Record) -> np.ndarray:
        """(H, W, 3) uint8, a copy."""
        if self.config.content == "depth":
            return self._shown(record.arrays["depth_mm"])
        frame, channels = record.arrays["image"], self.about.channels
        colours = ("NIR",) * 3 if self.config.content == "nir" else ("R", "G", "B")
        if self.config.color_mode is ColorMode.BGR:
            colours = colours[::-1]
        return np.ascontiguousarray(frame[..., [channels.index(name) for name in colours]])

    def _shown(self, depth_mm: np.ndarray) -> np.ndarray:
        """Indentation against the skin at rest, as grey. Raises RuntimeError before there is a rest."""
        if self.rest_mm is None:
            raise RuntimeError(f"{self}: no depth at rest: call tare() while nothing touches the skin")
        low, high = self.config.depth_range_mm
        grey = np.clip(np.round(255 * (self.rest_mm - depth_mm - low) / (high - low)), 0, 255).astype(
            np.uint8
        )
        return np.repeat(grey[..., None], 3, axis=2)
