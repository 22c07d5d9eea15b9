"""What a stream says of itself before its first record: sensor, units, geometry, and what computes.

The message has two parts: b"about" and JSON. A server sends it to whoever subscribes. This module needs
nothing but Python.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

TOPIC = b"about"
FORMAT_VERSION = 1


class AboutError(ValueError):
    """A message that does not describe a stream; the message of the error is one line."""


@dataclass(frozen=True)
class About:
    """A stream's description.

    scene : name of the scene; bundle_sha256 : of the sensor's bundle
    height_px, width_px, channels : of a frame; pitch_mm : between the centres of two pixels
    depth_origin_px : (row, column) of the image where depth and force map begin: they are without the rim
    force_axes : the axes of `force_n`, () where no force is found
    arrays : the names of the arrays that records have
    validity : all reasons for which a frame may be suspect
    via : what computes: "emulator", "sim", "uio" or "pynq"
    simulated_clock : whether latencies are counted by a simulated clock; clock_mhz : the hardware's clock
    source : where frames come from; frames_per_second : of the source, None where it is not known
    """

    scene: str
    bundle_sha256: str
    height_px: int
    width_px: int
    channels: tuple[str, ...]
    pitch_mm: float
    depth_origin_px: tuple[int, int]
    force_axes: tuple[str, ...]
    arrays: tuple[str, ...]
    validity: tuple[str, ...]
    via: str
    simulated_clock: bool
    clock_mhz: float
    source: str
    frames_per_second: float | None = None

    @property
    def units(self) -> dict[str, str]:
        """Units of a record's fields."""
        return {
            "source_time_ns": "ns",
            "force_n": "N",
            "slip_px": "px",
            "depth_mm": "mm",
            "normals": "1",
            "force_map_n": "N",
            "image": "1",
        }


def encode(about: About) -> list[bytes]:
    """The parts of the message."""
    content = {"format_version": FORMAT_VERSION, **asdict(about), "units": about.units}
    return [TOPIC, json.dumps(content, separators=(",", ":"), allow_nan=False).encode()]


def decode(parts: Sequence[bytes | memoryview]) -> About:
    """The description in a message. Raises AboutError, one line."""
    if len(parts) != 2 or bytes(parts[0]) != TOPIC:
        raise AboutError(f"message of {len(parts)} parts: describes no stream")
    try:
        content = json.loads(bytes(parts[1]))
    except ValueError:
        raise AboutError("description of a stream: no JSON") from None
    version = content.get("format_version") if isinstance(content, dict) else None
    if version != FORMAT_VERSION:
        raise AboutError(f"stream: format_version = {version!r}: this version reads {FORMAT_VERSION}")
    names = About.__dataclass_fields__
    missing = next((name for name in names if name not in content), None)
    if missing is not None:
        raise AboutError(f"description of a stream: {missing}: missing")
    values = {name: tuple(v) if isinstance(v := content[name], list) else v for name in names}
    return About(**values)
