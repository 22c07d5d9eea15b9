"""The quality of service of our topics, as `rosbags` writes it to logs for `ros2 bag play`."""

import json

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import dump_qos_v9

from fastac.streaming.ros.topics import DEPTH

NEVER = QosTime(9223372036, 854775807)
"""The time that stands for "no limit"."""
OFFERED = Qos(
    history=QosHistory.KEEP_LAST,
    depth=DEPTH,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.VOLATILE,
    deadline=NEVER,
    lifespan=NEVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=NEVER,
    avoid_ros_namespace_conventions=False,
)


def offered() -> str:
    """OFFERED as the metadata of an MCAP channel has it for ROS 2 Jazzy: YAML, of which JSON is a part."""
    return json.dumps(dump_qos_v9([OFFERED]))
