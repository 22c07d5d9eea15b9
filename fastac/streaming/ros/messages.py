"""Records of a stream as contents of standard ROS 2 messages, whoever writes or publishes these.

Axes are the sensor's: x along image columns, y along rows, z outwards from the camera, the origin at the
image's centre and at the height of the lowest corner of the skin at rest. So has REP 103 the frame of a
camera: x right, y down, z forward. Lengths become metres, forces stay newtons. Every message has the source's
time stamp and the one frame.

Needs NumPy and nothing else: ROS 2 is not imported.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord
from fastac.streaming.ros.topics import ALL, FRAME_ID, NESTED, Topic, topics

OK, WARN, ERROR = 0, 1, 2
"""Levels of a diagnostic_msgs/msg/DiagnosticStatus."""
FLOAT32 = 7
"""Type of a sensor_msgs/msg/PointField."""
COLOURS = ("B", "G", "R")
TOPICS = {topic.name: topic for topic in ALL}


@dataclass(frozen=True)
class Message:
    """A message: its topic, and its fields by name; messages within are dictionaries, too."""

    topic: Topic
    content: dict[str, Any]


def build(
    classes: Mapping[str, Callable[..., Any]],
    kind: str,
    content: dict[str, Any],
    plain: Callable[[str, Any], Any] = lambda name, value: value,
) -> Any:
    """A message of the type `kind`, made by its class and those of the messages within it.

    plain : gives what a field takes that is no message, from its name and its value
    """

    def of(name: str, value: Any) -> Any:
        if isinstance(value, dict):
            return build(classes, NESTED[name], value, plain)
        if isinstance(value, list):
            return [of(name, one) for one in value]
        return plain(name, value)

    return classes[kind](**{name: of(name, value) for name, value in content.items()})


class Messages:
    """Makes the messages of each record of one stream.

    frame_id : of the frame that all values are in
    unmeasured : what stands for the axes of force and torque that the sensor does not measure
    Raises ValueError for images whose channels are not B, G, R and perhaps NIR.
    """

    def __init__(self, about: About, *, frame_id: str = FRAME_ID, unmeasured: float = math.nan):
        if "image" in about.arrays and about.channels not in (COLOURS, (*COLOURS, "NIR")):
            raise ValueError(f"channels {', '.join(about.channels)}: images of B, G, R and NIR are known")
        self.about, self.frame_id, self.unmeasured = about, frame_id, unmeasured
        self.topics = topics(about)
        self._xy_m = self._places_m()

    def of(self, record: StreamRecord) -> Iterator[Message]:
        """The record's messages: one for each topic that it has values for, and `status` always.

        Of a lost frame only `status` is sent, and its image where the stream has images.
        """
        second, ns = divmod(record.source_time_ns, 1_000_000_000)
        header = {"stamp": {"sec": second, "nanosec": ns}, "frame_id": self.frame_id}
        for name, content in self._contents(record):
            yield Message(TOPICS[name], {"header": header, **content})

    def _contents(self, record: StreamRecord) -> Iterator[tuple[str, dict[str, Any]]]:
        """Topic's name and the fields but for the header."""
        if record.force_n:
            nothing = dict.fromkeys("xyz", self.unmeasured)
            yield "wrench", {"wrench": {"force": nothing | record.force_n, "torque": nothing}}
        if record.depth_mm is not None:
            depth_m = metres(record.depth_mm)
            yield "points", self._points(depth_m, record.normals)
            yield "depth", image("32FC1", depth_m)
        if record.normals is not None:
            yield "normals", image("32FC3", record.normals)
        if record.force_map_n is not None:
            shares = record.force_map_n
            yield "force_map", image(f"32FC{len(shares)}", np.moveaxis(shares, 0, -1))
        if record.image is not None:
            yield "image_raw", image("bgr8", record.image[..., :3])
            if record.image.shape[-1] > len(COLOURS):
                yield "nir/image_raw", image("mono8", record.image[..., 3])
        yield "status", {"status": [self._frame(record), self._timing(record)]}

    def _places_m(self) -> np.ndarray:
        """(H - 2, W - 2, 2) float32: x and y of the skin's points."""
        about = self.about
        rim_v, rim_u = about.depth_origin_px
        u = np.arange(rim_u, about.width_px - rim_u) - (about.width_px - 1) / 2
        v = np.arange(rim_v, about.height_px - rim_v) - (about.height_px - 1) / 2
        return metres(np.stack(np.meshgrid(u, v), axis=-1) * about.pitch_mm)

    def _points(self, depth_m: np.ndarray, normals: np.ndarray | None) -> dict[str, Any]:
        """Fields of the point cloud, a point for each value of the depth, in its rows and columns."""
        names, parts = ["x", "y", "z"], [self._xy_m, depth_m[..., None]]
        rows, columns = depth_m.shape
        if normals is not None:
            rim_v, rim_u = self.about.depth_origin_px
            names += ["normal_x", "normal_y", "normal_z"]
            parts.append(normals[rim_v : rim_v + rows, rim_u : rim_u + columns])
        points = np.concatenate(parts, axis=-1, dtype="<f4")
        step = 4 * len(names)
        return {
            "height": rows,
            "width": columns,
            "fields": [
                {"name": name, "offset": 4 * k, "datatype": FLOAT32, "count": 1}
                for k, name in enumerate(names)
            ],
            "is_bigendian": False,
            "point_step": step,
            "row_step": step * columns,
            "data": octets(points),
            "is_dense": True,
        }

    def _frame(self, record: StreamRecord) -> dict[str, Any]:
        """What is known of the frame beside its arrays and force."""
        remarks = [name for name in ("lost", "bad", "slipping") if getattr(record, name)]
        if record.suspect:
            remarks.append(" ".join(["suspect:", *record.reasons]))
        if record.errors:
            remarks.append(" ".join(["errors:", *record.errors]))
        flagged = record.bad or record.suspect or bool(record.errors)
        flags = {name: str(getattr(record, name)).lower() for name in ("lost", "bad", "suspect", "slipping")}
        values = {
            "frame": record.frame,
            **flags,
            "reasons": " ".join(record.reasons),
            "errors": " ".join(record.errors),
            "slip_px": record.slip_px,
            "slip_dots": record.slip_dots,
            **{f"force_raw.{axis}": raw for axis, raw in record.force_raw.items()},
        }
        level = ERROR if record.lost else WARN if flagged else OK
        return self._status("fastac: frame", level, ", ".join(remarks) or "ok", values)

    def _timing(self, record: StreamRecord) -> dict[str, Any]:
        """The hardware's clock counts and the host's latency, which are not the same from run to run."""
        clock = "a simulated clock" if self.about.simulated_clock else "the hardware's clock"
        return self._status("fastac: timing", OK, f"times in hardware are of {clock}", vars(record.timing))

    def _status(self, name: str, level: int, message: str, values: dict[str, Any]) -> dict[str, Any]:
        """Fields of a DiagnosticStatus; what is None is left out."""
        pairs = [{"key": key, "value": str(value)} for key, value in values.items() if value is not None]
        return {
            "level": level,
            "name": name,
            "message": message,
            "hardware_id": self.about.bundle_sha256,
            "values": pairs,
        }


def metres(length_mm: np.ndarray) -> np.ndarray:
    """Lengths in m, float32, rounded once."""
    return (length_mm.astype(np.float64) / 1000).astype("<f4")


def octets(array: np.ndarray) -> np.ndarray:
    """The bytes of an array in C order, little-endian, as uint8."""
    little = array.dtype.newbyteorder("<")
    return np.ascontiguousarray(array, little).reshape(-1).view(np.uint8)


def image(encoding: str, array: np.ndarray) -> dict[str, Any]:
    """Fields but for the header of a sensor_msgs/msg/Image; (rows, columns) or (rows, columns, channels)."""
    rows, columns = array.shape[:2]
    data = octets(array)
    return {
        "height": rows,
        "width": columns,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": len(data) // rows,
        "data": data,
    }
