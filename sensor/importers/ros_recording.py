"""Images and wrenches of a ROS 2 recording: a rosbag2 folder, or one file .mcap or .db3 of it.

Messages are read as the standard definitions say, not by those in the file. Needs the package `rosbags`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np

from fastac.sensor.importers.footage import ImportFailure, encoded_photograph, file_in

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGES, WRENCHES = (RAW, COMPRESSED), ("geometry_msgs/msg/WrenchStamped",)
ENCODINGS = {"bgr8": (3, (0, 1, 2)), "rgb8": (3, (2, 1, 0)), "bgra8": (4, (0, 1, 2)), "rgba8": (4, (2, 1, 0))}
"""Of images: bytes of a pixel, and which of them are B, G and R."""
Clock = Literal["stamp", "log"]
"""The time of a message: its header's stamp, or when it was recorded."""


def require_packages() -> None:
    """Raise ImportFailure unless recordings can be read."""
    if find_spec("rosbags") is None:
        raise ImportFailure("ROS 2 recordings need rosbags: run pip install -e '.[ros]'")


@cache
def _typestore():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@contextmanager
def _opened(path: Path) -> Iterator:
    """The recording's reader. Raises ImportFailure for whatever happens in the block."""
    from rosbags.rosbag2 import Reader

    if not path.exists():
        raise ImportFailure(f"{path}: no such file or folder")
    for file in path.iterdir() if path.is_dir() else ():
        file_in(path, file.name)
    try:
        with Reader(path) as reader:
            yield reader
    except ImportFailure:
        raise
    except Exception as error:  # rosbags, sqlite3 and decompression raise whatever they meet
        reason = " ".join((str(error) or type(error).__name__).split())
        raise ImportFailure(f"{path}: not a readable ROS 2 recording: {reason[:200]}") from None


def _connections(path: Path, reader, topic: str | None, kinds: tuple[str, ...]) -> list:
    """The connections of a topic, or of the only one of these types. Raises ImportFailure without one."""
    fitting = sorted({found.topic for found in reader.connections if found.msgtype in kinds})
    wanted = topic if topic is not None else fitting[0] if len(fitting) == 1 else None
    if wanted not in fitting:
        names = " or ".join(kinds)
        have = f"one of {', '.join(fitting)}" if fitting else "a recording with one"
        said = f"topic {topic!r}" if topic is not None else "topic"
        raise ImportFailure(f"{path}: {said} of {names}: expected {have}")
    return [found for found in reader.connections if found.topic == wanted and found.msgtype in kinds]


def _time_ns(message, recorded_ns: int, clock: Clock) -> int:
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec if clock == "stamp" else recorded_ns


def _image(message, kind: str, place: str) -> np.ndarray:
    """The image of a message, (height, width, 3) uint8 in the order B, G, R."""
    if kind == COMPRESSED:
        return encoded_photograph(bytes(message.data), place)
    if message.encoding not in ENCODINGS:
        raise ImportFailure(
            f"{place}: encoding = {message.encoding!r}: expected one of {', '.join(ENCODINGS)}"
        )
    channels, order = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    if not height or not width or step < channels * width or len(message.data) < height * step:
        size = f"{width} x {height} px of {step} bytes a row"
        raise ImportFailure(f"{place}: {size}: {len(message.data)} bytes are there")
    rows = np.asarray(message.data[: height * step], np.uint8).reshape(height, step)
    return rows[:, : channels * width].reshape(height, width, channels)[..., order]


@dataclass(frozen=True)
class RosRecording:
    """A recording's times: of its images and, in order, of its wrenches with their forces.

    image_ns (images,), wrench_ns (wrenches,) int64; force_n (wrenches, 3) x, y, z as recorded
    """

    path: Path
    image_topic: str
    clock: Clock
    image_ns: np.ndarray
    wrench_ns: np.ndarray
    force_n: np.ndarray

    @property
    def name(self) -> str:
        return self.path.resolve().stem

    @classmethod
    def scan(
        cls, path: Path, image_topic: str | None, wrench_topic: str | None, clock: Clock
    ) -> "RosRecording":
        """Read all times and forces. Raises ImportFailure for damaged files and topics that are not there."""
        image_ns, wrench_ns, force_n = [], [], []
        with _opened(path) as reader:
            images = _connections(path, reader, image_topic, IMAGES)
            wrenches = _connections(path, reader, wrench_topic, WRENCHES)
            for connection, recorded_ns, content in reader.messages([*images, *wrenches]):
                message = _typestore().deserialize_cdr(content, connection.msgtype)
                time_ns = _time_ns(message, recorded_ns, clock)
                if connection.msgtype in IMAGES:
                    image_ns.append(time_ns)
                    continue
                force = message.wrench.force
                wrench_ns.append(time_ns)
                force_n.append((force.x, force.y, force.z))
        for what, found in (("image", image_ns), ("wrench", wrench_ns)):
            if not found:
                raise ImportFailure(f"{path}: no {what} was recorded")
        order = np.argsort(wrench_ns, kind="stable")
        times = np.array(image_ns, np.int64), np.array(wrench_ns, np.int64)[order]
        return cls(path, images[0].topic, clock, *times, np.array(force_n, float)[order])

    def nearest(self, tolerance_ns: int) -> np.ndarray:
        """The row of the wrench nearest in time to each image, (images,); -1 where none is near enough."""
        after = np.searchsorted(self.wrench_ns, self.image_ns).clip(1, max(len(self.wrench_ns) - 1, 1))
        both = np.stack([after - 1, after.clip(max=len(self.wrench_ns) - 1)])
        apart = np.abs(self.wrench_ns[both] - self.image_ns)
        row = np.where(apart[0] <= apart[1], both[0], both[1])
        return np.where(apart.min(axis=0) <= tolerance_ns, row, -1)

    def images(self, wanted: np.ndarray) -> Iterator[tuple[int, np.ndarray, str]]:
        """The images whose numbers are true in `wanted`, (images,) bool: number, image, place for errors."""
        chosen = np.flatnonzero(wanted)
        with _opened(self.path) as reader:
            connections = _connections(self.path, reader, self.image_topic, IMAGES)
            for k, (connection, _, content) in enumerate(reader.messages(connections)):
                if not len(chosen) or k > chosen[-1]:
                    return
                if wanted[k]:
                    place = f"{self.path}: {self.image_topic}: image {k}"
                    message = _typestore().deserialize_cdr(content, connection.msgtype)
                    yield k, _image(message, connection.msgtype, place), place
