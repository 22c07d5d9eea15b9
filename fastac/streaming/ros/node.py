"""A ROS 2 node that publishes a stream's records: `python -m fastac.streaming.ros.node`.

It takes the stream from a running `fastac serve` and needs, beside ROS 2's own rclpy and standard messages,
NumPy and pyzmq and nothing else. It waits for a server, and again when a stream has ended.

    python -m fastac.streaming.ros.node --ros-args -p address:=tcp://127.0.0.1:5599 -p frame_id:=left_tip

Parameters, read once at the start:

    address      of the stream
    frame_id     frame of all messages
    topics       names separated by commas, such as wrench,status; empty: all that the stream has
    unmeasured   what stands for axes of force and torque that are not measured: nan, or zero
    stamp        source: the frames' own time stamps; now: the node's time when the record came
    latest       true: skip records when the node cannot keep up; false: publish all, however late
"""

import array
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from fastac.streaming.about import About, AboutError
from fastac.streaming.address import DEFAULT_ADDRESS, AddressError
from fastac.streaming.client import connect
from fastac.streaming.messages import StreamError
from fastac.streaming.record import RecordError, StreamRecord
from fastac.streaming.ros.messages import Messages, build
from fastac.streaming.ros.topics import ALL, DEPTH, FRAME_ID, NESTED

NAME = "fastac"
UNMEASURED = {"nan": float("nan"), "zero": 0.0}
STAMPS = ("source", "now")
WAIT_S = 1.0
"""How long the node waits for a stream before it looks after its own calls."""
DEFAULTS = {
    "address": DEFAULT_ADDRESS,
    "frame_id": FRAME_ID,
    "topics": "",
    "unmeasured": "nan",
    "stamp": "source",
    "latest": False,
}


class NodeError(ValueError):
    """A parameter that the node cannot have; the message is one line."""


def classes() -> dict[str, type]:
    """The classes of all message types that are sent, by name. Raises ImportError without ROS 2."""
    found = {}
    for kind in {*NESTED.values(), *(topic.type for topic in ALL)}:
        package, _, name = kind.split("/")
        found[kind] = getattr(import_module(f"{package}.msg"), name)
    return found


def plain(name: str, value: Any) -> Any:
    """A field's value as rclpy takes it: bytes in an array, an octet as bytes."""
    if isinstance(value, np.ndarray):
        octets = array.array("B")
        octets.frombytes(value.data)
        return octets
    return bytes([value]) if name == "level" else value


@dataclass(frozen=True)
class Parameters:
    """The node's parameters, as the module says."""

    address: str
    frame_id: str
    topics: tuple[str, ...]
    unmeasured: float
    stamp: str
    latest: bool

    @classmethod
    def of(cls, node: Any) -> "Parameters":
        """Those of a node, declared. Raises NodeError."""
        given = {name: node.declare_parameter(name, default).value for name, default in DEFAULTS.items()}
        names = tuple(name for name in given["topics"].replace(" ", "").split(",") if name)
        known = [topic.name for topic in ALL]
        for name in names:
            if name not in known:
                raise NodeError(f"parameter topics: {name!r}: expected some of {', '.join(known)}")
        for key, allowed in (("unmeasured", tuple(UNMEASURED)), ("stamp", STAMPS)):
            if given[key] not in allowed:
                raise NodeError(f"parameter {key}: {given[key]!r}: expected {' or '.join(allowed)}")
        return cls(**{**given, "topics": names, "unmeasured": UNMEASURED[given["unmeasured"]]})


class Publishers:
    """A sink that publishes a stream's records on a node's topics, below the node's own name.

    Publishers are reliable and volatile and keep DEPTH messages; parameters `qos_overrides` change that.
    """

    def __init__(self, node: Any, about: About, parameters: Parameters):
        from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
        from rclpy.qos_overriding_options import QoSOverridingOptions

        self._node, self._classes = node, classes()
        self._now = parameters.stamp == "now"
        self._messages = Messages(about, frame_id=parameters.frame_id, unmeasured=parameters.unmeasured)
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.VOLATILE,
        )
        self._publishers = {
            topic.name: node.create_publisher(
                self._classes[topic.type],
                f"~/{topic.name}",
                profile,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
            for topic in self._messages.topics
            if not parameters.topics or topic.name in parameters.topics
        }

    def add(self, record: StreamRecord) -> None:
        if self._now:
            record = replace(record, source_time_ns=self._node.get_clock().now().nanoseconds)
        for message in self._messages.of(record):
            publisher = self._publishers.get(message.topic.name)
            if publisher is not None:
                publisher.publish(build(self._classes, message.topic.type, message.content, plain))

    def close(self) -> None:
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)


def publish(node: Any, parameters: Parameters, turn: Callable[[], bool]) -> None:
    """Publish streams one after another as long as `turn`, called after each record or wait, says so."""
    waits = False
    while turn():
        try:
            with connect(parameters.address, latest=parameters.latest, timeout_s=WAIT_S) as stream:
                waits = False
                node.get_logger().info(f"{parameters.address}: scene {stream.about.scene}")
                if not _publish_one(node, parameters, stream, turn):
                    return
        except (AboutError, StreamError) as error:
            if not waits:
                node.get_logger().warning(f"{error}; waiting for one")
            waits = True


def _publish_one(node: Any, parameters: Parameters, stream: Any, turn: Callable[[], bool]) -> bool:
    """Publish one stream to its end; whether that is because it ended."""
    publishers = Publishers(node, stream.about, parameters)
    try:
        while True:
            try:
                record = next(stream)
            except RecordError as error:
                node.get_logger().warning(str(error))
                continue
            except StopIteration:
                node.get_logger().info(
                    f"end of the stream: {stream.received} records, {stream.missed} missed"
                )
                return True
            publishers.add(record)
            if not turn():
                return False
    finally:
        publishers.close()


def main(arguments: list[str] | None = None) -> None:
    try:
        import rclpy
        from rclpy.executors import ExternalShutdownException
    except ImportError:
        sys.exit("Error: rclpy is not there: run `source /opt/ros/DISTRO/setup.bash` first")
    rclpy.init(args=arguments)
    node = rclpy.create_node(NAME)

    def turn() -> bool:
        if rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0)
        return rclpy.ok()

    try:
        publish(node, Parameters.of(node), turn)
    except (AddressError, NodeError) as error:
        sys.exit(f"Error: {error}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
