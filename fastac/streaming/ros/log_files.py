"""What logs for ROS 2 have in common: the packages needed, names of topics, what they say of themselves."""

import re
from importlib.util import find_spec
from pathlib import Path

from fastac.streaming import about as abouts
from fastac.streaming.ros.messages import Messages
from fastac.streaming.ros.topics import Topic

PACKAGES = ("mcap", "rosbags")
FLUSH_S = 1.0
"""Records that come longer than this after others find those in the file already."""
NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
AXES = "x along image columns, y along image rows, z outwards from the camera; origin at the image's centre"
FORCE = "force of the skin on what it touches, z positive in compression; torque is not measured"


class LogError(ValueError):
    """A log that cannot be written; the message is one line."""


def require_packages() -> None:
    """Raise LogError unless the packages that write logs are installed."""
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise LogError(f"logs for ROS 2 need {' and '.join(missing)}: run pip install -e '.[ros]'")


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise LogError where a log would replace what is there, unless `force` and it is nothing but a log."""
    if path.exists() and not force:
        raise LogError(f"{path}: exists already; --force replaces it")
    if path.is_dir():
        written = {"metadata.yaml", "metadata.yaml.tmp"}
        written |= {path.name + ending for ending in (".mcap", ".db3", ".db3-journal")}
        other = next((file for file in path.iterdir() if file.name not in written), None)
        if other is not None:
            raise LogError(f"{path}: holds {other.name}, which is no part of a log: not replaced")


def checked(namespace: str) -> str:
    """The namespace of topics, such as /fastac. Raises LogError for one that ROS 2 has no such names in."""
    if not NAME.fullmatch(namespace):
        raise LogError(f"namespace {namespace!r}: expected names such as /fastac or /left/finger")
    return namespace


def name_in(namespace: str, topic: Topic) -> str:
    """A topic's whole name."""
    return f"{namespace}/{topic.name}"


def described(messages: Messages, namespace: str) -> dict[str, str]:
    """What a log says of itself: sensor, axes, the unit of each topic, and the whole description as JSON."""
    about = messages.about
    units = {f"unit of {name_in(namespace, topic)}": topic.unit for topic in messages.topics if topic.unit}
    return {
        "scene": about.scene,
        "bundle_sha256": about.bundle_sha256,
        "via": about.via,
        "source": about.source,
        "frame_id": messages.frame_id,
        "axes": AXES,
        "force": FORCE,
        **units,
        "about": abouts.encode(about)[1].decode(),
    }
