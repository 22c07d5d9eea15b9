"""A stand-in for rclpy and the packages of standard messages, for tests where no ROS 2 is.

Messages are made from the definitions that `rosbags` has, and are as strict as those of ROS 2: a field that
the type does not have, or a value of another type than its setter takes, is an AssertionError. What the node
does with rclpy is checked, too: names and types of parameters, publishers and their quality of service.
"""

import array
import sys
from dataclasses import dataclass, field
from enum import Enum
from types import ModuleType, SimpleNamespace

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
PACKAGES = ("builtin_interfaces", "std_msgs", "geometry_msgs", "sensor_msgs", "diagnostic_msgs")
INTEGERS = {f"{sign}int{bits}": (sign, bits) for sign in ("u", "") for bits in (8, 16, 32, 64)}


def _default(kind, of):
    if kind == Nodetype.NAME:
        return message_class(of)()
    if kind == Nodetype.SEQUENCE:
        return array.array("B") if of[0] == (Nodetype.BASE, ("uint8", 0)) else []
    base = of[0]
    return {"string": "", "bool": False, "byte": b"\0", "float64": 0.0, "float32": 0.0}.get(base, 0)


def _check(where: str, kind, of, value) -> None:
    """What the setter of a field asserts."""
    if kind == Nodetype.NAME:
        assert type(value) is message_class(of), f"{where}: {type(value)} is no {of}"
    elif kind == Nodetype.SEQUENCE:
        if of[0] == (Nodetype.BASE, ("uint8", 0)):
            assert isinstance(value, array.array), f"{where}: {type(value)}: would be checked octet by octet"
            assert value.typecode == "B", where
        else:
            assert isinstance(value, (list, tuple)), f"{where}: {type(value)} is no sequence"
            for one in value:
                _check(where, *of[0], one)
    else:
        _check_plain(where, of[0], value)


def _check_plain(where: str, base: str, value) -> None:
    if base in INTEGERS:
        sign, bits = INTEGERS[base]
        low, high = (0, 2**bits) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        assert isinstance(value, int), f"{where}: {value!r} is no integer"
        assert low <= value < high, f"{where}: {value} is no {base}"
    elif base == "byte":
        assert isinstance(value, bytes), f"{where}: {value!r} is no byte"
        assert len(value) == 1, where
    else:
        expected = {"string": str, "bool": bool, "float64": float, "float32": float}[base]
        assert isinstance(value, expected), f"{where}: {value!r} is no {base}"


CLASSES: dict[str, type] = {}


def message_class(name: str) -> type:
    """The class of a message type such as sensor_msgs/msg/Image."""
    if name not in CLASSES:
        fields = dict(STORE.fielddefs[name][1])

        def __init__(self, **given):
            assert not given.keys() - fields.keys(), f"{name} has no {given.keys() - fields.keys()}"
            for key, (kind, of) in fields.items():
                setattr(self, key, given.get(key, _default(kind, of)))

        def __setattr__(self, key, value):
            assert key in fields, f"{name} has no {key}"
            _check(f"{name}.{key}", *fields[key], value)
            object.__setattr__(self, key, value)

        body = {"__init__": __init__, "__setattr__": __setattr__}
        CLASSES[name] = type(name.rsplit("/", 1)[1], (), body)
    return CLASSES[name]


class HistoryPolicy(Enum):
    KEEP_LAST = 1
    KEEP_ALL = 2


class ReliabilityPolicy(Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass(frozen=True, kw_only=True)
class QoSProfile:
    history: HistoryPolicy
    depth: int
    reliability: ReliabilityPolicy
    durability: DurabilityPolicy


class QoSOverridingOptions:
    @classmethod
    def with_default_policies(cls):
        return cls()


class ExternalShutdownException(Exception):
    pass


@dataclass
class Publisher:
    kind: type
    topic: str
    qos: QoSProfile
    sent: list = field(default_factory=list)
    destroyed: bool = False

    def publish(self, message) -> None:
        assert not self.destroyed
        assert type(message) is self.kind, f"{self.topic}: {type(message)} is no {self.kind}"
        self.sent.append(message)


class Logger:
    def __init__(self):
        self.lines: list[str] = []

    def info(self, text: str) -> None:
        self.lines.append(text)

    warning = info


class Node:
    """given : values of parameters, as of `--ros-args -p name:=value`"""

    def __init__(self, name: str, given: dict):
        self.name, self._given, self._logger = name, given, Logger()
        self._declared: set[str] = set()
        self.publishers: list[Publisher] = []
        self.destroyed = False
        self.now_ns = 0

    def declare_parameter(self, name: str, value):
        assert name not in self._declared, f"{name} is declared already"
        assert isinstance(value, (str, bool, int, float)), f"{name}: {value!r}: no type follows from it"
        self._declared.add(name)
        found = self._given.get(name, value)
        assert type(found) is type(value), f"{name}: {found!r} is of another type than {value!r}"
        return SimpleNamespace(name=name, value=found)

    def create_publisher(self, kind, topic: str, qos, *, qos_overriding_options=None) -> Publisher:
        assert kind in CLASSES.values()
        assert isinstance(qos, QoSProfile)
        assert isinstance(qos_overriding_options, QoSOverridingOptions)
        topic = topic.replace("~", f"/{self.name}")
        assert topic not in {one.topic for one in self.publishers if not one.destroyed}
        self.publishers.append(Publisher(kind, topic, qos))
        return self.publishers[-1]

    def destroy_publisher(self, publisher: Publisher) -> None:
        assert publisher in self.publishers
        publisher.destroyed = True

    def get_logger(self) -> Logger:
        return self._logger

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now_ns))

    def destroy_node(self) -> None:
        self.destroyed = True


class Ros:
    """The one context. on_turn : called whenever the node looks after its own calls"""

    def __init__(self, parameters: dict, on_turn):
        self.parameters, self.on_turn = parameters, on_turn
        self.node: Node | None = None
        self.is_up = False

    def init(self, *, args=None) -> None:
        assert not self.is_up
        self.is_up = True

    def ok(self) -> bool:
        return self.is_up

    def create_node(self, name: str) -> Node:
        assert self.is_up
        self.node = Node(name, self.parameters)
        return self.node

    def spin_once(self, node: Node, *, timeout_sec: float) -> None:
        assert self.is_up
        assert node is self.node
        self.on_turn(self)

    def shutdown(self) -> None:
        self.is_up = False

    try_shutdown = shutdown


def install(monkeypatch, parameters: dict | None = None, on_turn=lambda ros: None) -> Ros:
    """Put the stand-in where imports find it, for one test."""
    ros = Ros(parameters or {}, on_turn)

    def module(name: str, **content) -> None:
        made = ModuleType(name)
        made.__path__ = []
        vars(made).update(content)
        monkeypatch.setitem(sys.modules, name, made)

    calls = ("init", "ok", "create_node", "spin_once", "shutdown", "try_shutdown")
    module("rclpy", **{name: getattr(ros, name) for name in calls})
    policies = (QoSProfile, HistoryPolicy, ReliabilityPolicy, DurabilityPolicy)
    module("rclpy.qos", **{one.__name__: one for one in policies})
    module("rclpy.qos_overriding_options", QoSOverridingOptions=QoSOverridingOptions)
    module("rclpy.executors", ExternalShutdownException=ExternalShutdownException)
    for package in PACKAGES:
        names = [name for name in STORE.fielddefs if name.startswith(f"{package}/msg/")]
        module(package)
        module(f"{package}.msg", **{name.rsplit("/", 1)[1]: message_class(name) for name in names})
    return ros
