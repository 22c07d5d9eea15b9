"""ROS 2 messages as bytes: CDR, by the message definitions that `rosbags` has."""

from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from fastac.streaming.ros.messages import Message, build


@cache
def typestore() -> Typestore:
    """The standard message types, which have been the same from Humble on."""
    return get_typestore(Stores.ROS2_JAZZY)


def serialised(message: Message) -> memoryview:
    """A message in CDR, little-endian."""
    kind = message.topic.type
    return typestore().serialize_cdr(build(typestore().types, kind, message.content), kind)


def definition(kind: str) -> tuple[str, str]:
    """The definition of a message type with those within it, and its hash, as ROS 2 writes both to files."""
    text, _ = typestore().generate_msgdef(kind, ros_version=2)
    return text, typestore().hash_rihs01(kind)
