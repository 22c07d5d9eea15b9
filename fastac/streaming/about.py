"""What a stream says of itself before its first record: sensor, units, geometry, and what computes.

The message has two parts: b"about" and JSON. A server sends it to whoever subscribes. This module needs
nothing but Python.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from fastac.streaming import json_text

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


CHECKS: dict[str, json_text.Check] = {
    "scene": json_text.text,
    "bundle_sha256": json_text.text,
    "height_px": json_text.count,
    "width_px": json_text.count,
    "channels": json_text.several(json_text.text),
    "pitch_mm": json_text.number,
    "depth_origin_px": json_text.several(json_text.count),
    "force_axes": json_text.several(json_text.text),
    "arrays": json_text.several(json_text.text),
    "validity": json_text.several(json_text.text),
    "via": json_text.text,
    "simulated_clock": json_text.flag,
    "clock_mhz": json_text.number,
    "source": json_text.text,
    "frames_per_second": json_text.or_none(json_text.number),
}


def encode(about: About) -> list[bytes]:
    """The parts of the message."""
    content = {"format_version": FORMAT_VERSION, **asdict(about), "units": about.units}
    return [TOPIC, json_text.write(content)]


def decode(parts: Sequence[bytes | memoryview]) -> About:
    """The description in a message. Raises AboutError, one line."""
    if len(parts) != 2 or bytes(parts[0]) != TOPIC:
        raise AboutError(f"message of {len(parts)} parts: describes no stream")
    try:
        return About(**json_text.values(json_text.read(parts[1], FORMAT_VERSION), CHECKS))
    except json_text.JsonError as error:
        raise AboutError(f"description of a stream: {error}") from None
