"""The ROS 2 topics of a stream: names, standard message types, units, and the quality of service advised.

Python and the descriptions of streams are all that is needed here: ROS 2 is not.
"""

from dataclasses import dataclass

from fastac.streaming.about import About

WRENCH = "geometry_msgs/msg/WrenchStamped"
IMAGE = "sensor_msgs/msg/Image"
POINTS = "sensor_msgs/msg/PointCloud2"
STATUS = "diagnostic_msgs/msg/DiagnosticArray"

NESTED = {
    "header": "std_msgs/msg/Header",
    "stamp": "builtin_interfaces/msg/Time",
    "wrench": "geometry_msgs/msg/Wrench",
    "force": "geometry_msgs/msg/Vector3",
    "torque": "geometry_msgs/msg/Vector3",
    "fields": "sensor_msgs/msg/PointField",
    "status": "diagnostic_msgs/msg/DiagnosticStatus",
    "values": "diagnostic_msgs/msg/KeyValue",
}
"""Type of the messages in a field, or of the elements of a field that is a list."""

FRAME_ID = "fastac_fingertip"
NAMESPACE = "/fastac"
DEPTH = 10
"""Messages that a publisher keeps for a slow subscriber. Publishers are reliable and volatile, as REP 2003
has it for sensors: a subscriber may then ask for reliable or for best effort."""


@dataclass(frozen=True)
class Topic:
    """A topic: its name below the node's, the type of its messages, unit and content of their values."""

    name: str
    type: str
    unit: str
    content: str


def topics(about: About) -> tuple[Topic, ...]:
    """The topics that a stream has messages for."""
    arrays = about.arrays
    there = {
        "wrench": bool(about.force_axes),
        "points": "depth_mm" in arrays,
        "depth": "depth_mm" in arrays,
        "normals": "normals" in arrays,
        "force_map": "force_map_n" in arrays,
        "image_raw": "image" in arrays,
        "nir/image_raw": "image" in arrays and "NIR" in about.channels,
    }
    return tuple(topic for topic in ALL if there.get(topic.name, True))


ALL = (
    Topic("wrench", WRENCH, "N", "force of the skin on what it touches"),
    Topic("points", POINTS, "m", "points of the skin, with normals"),
    Topic("depth", IMAGE, "m", "32FC1: height z of the skin"),
    Topic("normals", IMAGE, "1", "32FC3: outward unit vectors x, y, z"),
    Topic("force_map", IMAGE, "N", "32FC1 or 32FC3: each pixel's share of the force"),
    Topic("image_raw", IMAGE, "1", "bgr8: what the camera sees"),
    Topic("nir/image_raw", IMAGE, "1", "mono8: the same in near infrared"),
    Topic("status", STATUS, "", "number and flags of every frame, slip, timing"),
)
