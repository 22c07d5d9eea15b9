"""The quality of service of our topics, as `rosbags` writes it to logs for `ros2 bag play`."""

from io import StringIO

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import dump_qos_v9
from ruamel.yaml import YAML

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


def as_yaml() -> str:
    """OFFERED as the metadata of an MCAP channel has it, in the form of ROS 2 Jazzy."""
    text = StringIO()
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.dump(dump_qos_v9([OFFERED]), text)
    return text.getvalue().strip()
