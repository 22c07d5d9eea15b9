"""Miniature ROS 2 recordings of a camera and a force gauge; need the extra `ros`."""

from pathlib import Path

import numpy as np
from mcap.writer import Writer as McapWriter
from miniatures import encoded, pressed
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
LOADS = (0, 0, 0, 2, 4, 0, 0, 3, 3)
"""Loads of the images, N: two presses."""
START_NS, STEP_NS = 1_700_000_000_000_000_000, 40_000_000


def header(time_ns: int):
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp, "camera")


def image(time_ns: int, picture: np.ndarray, encoding: str):
    """An Image, or with the encoding png or jpeg a CompressedImage; raw rows have two bytes to spare."""
    if encoding in ("png", "jpeg"):
        content = np.frombuffer(encoded(picture, encoding.upper()), np.uint8)
        return STORE.types[COMPRESSED](header(time_ns), encoding, content)
    colours = picture[..., ::-1] if encoding.startswith("bgr") else picture
    if encoding.endswith("a8"):
        colours = np.concatenate([colours, np.full_like(colours[..., :1], 255)], axis=2)
    height, width, channels = colours.shape
    rows = np.pad(colours.reshape(height, -1), ((0, 0), (0, 2)))
    step = channels * width + 2
    return STORE.types[IMAGE](header(time_ns), height, width, encoding, 0, step, rows.ravel())


def wrench(time_ns: int, force: tuple[float, float, float]):
    types = STORE.types
    vector = types["geometry_msgs/msg/Vector3"]
    both = types["geometry_msgs/msg/Wrench"](vector(*map(float, force)), vector(0.0, 0.0, 0.0))
    return types[WRENCH](header(time_ns), both)


def messages(encoding: str = "rgb8", offset_n: float = 0.0, xy: float = 0.125, lost: tuple[int, ...] = ()):
    """Topic and time of each message with itself: images of 64 x 48 px, and wrenches 5 ms later.

    xy : forces along x and -y as a share of the load; lost : images without a wrench
    """
    found = []
    for k, load in enumerate(LOADS):
        time_ns = START_NS + k * STEP_NS
        found.append(("/camera", time_ns, image(time_ns, pressed(load), encoding)))
        if k not in lost:
            late = time_ns + 5_000_000
            found.append(("/gauge", late, wrench(late, (xy * load, -xy * load, load + offset_n))))
    return found


def write_bag(path: Path, given, storage: str = "mcap", log_shift_ns: int = 0) -> Path:
    """A rosbag2 folder; messages are logged so much after their stamps."""
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, time_ns, message in given:
            if topic not in connections:
                kind = message.__msgtype__
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            content = STORE.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], time_ns + log_shift_ns, content)
    return path


def write_mcap(path: Path, given) -> Path:
    """One MCAP file, by the package mcap."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        channels = {}
        for topic, time_ns, message in given:
            kind = message.__msgtype__
            if topic not in channels:
                text, _ = STORE.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            content = bytes(STORE.serialize_cdr(message, kind))
            writer.add_message(channels[topic], time_ns, content, time_ns)
        writer.finish()
    return path
