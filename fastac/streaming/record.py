"""The record of one frame in a stream, the same whatever computed it, and its form in bytes.

A record is a message of several parts, which any language can read without this package:

    part 0    b"record"
    part 1    JSON, the facts: number of the frame, its time stamp, force, slip, flags, and for each array its
              name, unit, type and shape
    part 2    JSON, what depends on when things happened: the hardware's clock counts, the host's latency, and
              the names of the errors that stood in the hardware's register
    part 3 …  the arrays in the order of part 1, C order, little-endian

Integers of the JSON need 64 bits: `source_time_ns`, `made_ns` and `force_raw` may exceed 2**53, beyond which
a reader that takes all numbers for floats, as JavaScript does, loses their last digits.

Everything but part 2 is a function of the frames and the sensor's bundle: emulator, simulated hardware and a
board give the same bytes. The messages before and after the records are those of about.py and end.py. This
module needs NumPy and nothing else.
"""

import hashlib
import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fastac.streaming import json_text

TOPIC = b"record"
FORMAT_VERSION = 1
ARRAYS = {
    "depth_mm": ("mm", "<f4"),
    "normals": ("1", "<f4"),
    "force_map_n": ("N", "<f4"),
    "image": ("1", "|u1"),
}
"""Unit and type of the arrays that a record may have."""
FIXED_PARTS = 3
MAX_ARRAY_BYTES = 2**28
MOST_AXES = 4


class RecordError(ValueError):
    """A message that is no record; the message of the error is one line."""


@dataclass(frozen=True)
class Timing:
    """When things happened; not the same from one run to the next.

    first_pixel_to_result_s, last_pixel_to_result_s : by the hardware's clock
    hardware_time_s : when the hardware accepted the frame's first pixel, s since its reset, by its clock
    host_latency_s : from the host's sending the frame to its having the result
    made_ns : when the record was made, ns since 1970 by the host's clock

    Latencies are None where the frame was lost.
    """

    first_pixel_to_result_s: float | None = None
    last_pixel_to_result_s: float | None = None
    hardware_time_s: float | None = None
    host_latency_s: float | None = None
    made_ns: int = 0


@dataclass(frozen=True, eq=False)
class StreamRecord:
    """What was found in one frame.

    frame : number of the frame in the stream, from 0; none is left out, lost frames are records too
    source_time_ns : the source's time stamp of the frame in ns; see `fastac.streaming.clock`
    lost : the frame was sent and no result came: nothing else is known of it
    bad : the frame's input was faulty and was repaired by the hardware
    suspect, reasons : the frame is not like those of training, and why: names such as "change"
    slipping : the dots in contact spread beyond the limit
    force_n : newtons by axis, {"z": 1.02}; z is positive in compression; {} where no force is found
    force_raw : the same as integers, the hardware's accumulators
    slip_px, slip_dots : spread of the dots in contact about a rigid motion in px, and their number, or None
    errors : names of the sticky errors that stood when the result came; those of later frames in flight may
        stand already, and how soon the host reads results counts too: so they are with the timing in bytes
    arrays : whichever of these are sent: depth_mm (H - 2, W - 2) float32, height z of the skin; normals
        (H, W, 3) float32; force_map_n (axes, H - 2, W - 2) float32; image (H, W, C) uint8, what was seen
    timing : clock counts and latencies
    """

    frame: int
    source_time_ns: int
    lost: bool = False
    bad: bool = False
    suspect: bool = False
    slipping: bool = False
    reasons: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    force_n: dict[str, float] = field(default_factory=dict)
    force_raw: dict[str, int] = field(default_factory=dict)
    slip_px: float | None = None
    slip_dots: int | None = None
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    timing: Timing = Timing()

    @property
    def depth_mm(self) -> np.ndarray | None:
        """(H - 2, W - 2) float32: height z of the skin without the image's rim; pressing lowers it; mm."""
        return self.arrays.get("depth_mm")

    @property
    def normals(self) -> np.ndarray | None:
        """(H, W, 3) float32: outward unit vectors."""
        return self.arrays.get("normals")

    @property
    def force_map_n(self) -> np.ndarray | None:
        """(axes, H - 2, W - 2) float32: each inner pixel's share of the force; N."""
        return self.arrays.get("force_map_n")

    @property
    def image(self) -> np.ndarray | None:
        """(H, W, C) uint8: the frame, channels B, G, R and, of four, NIR."""
        return self.arrays.get("image")

    @property
    def digest(self) -> str:
        """SHA-256 in hexadecimal of all but part 2."""
        parts = encode(self)
        sha = hashlib.sha256()
        for part in (*parts[:2], *parts[FIXED_PARTS:]):
            sha.update(len(part).to_bytes(8, "little"))
            sha.update(part)
        return sha.hexdigest()


SCALARS: dict[str, json_text.Check] = {
    "frame": json_text.count,
    "source_time_ns": json_text.whole,
    "lost": json_text.flag,
    "bad": json_text.flag,
    "suspect": json_text.flag,
    "slipping": json_text.flag,
    "reasons": json_text.several(json_text.text),
    "force_n": json_text.by_name(json_text.number),
    "force_raw": json_text.by_name(json_text.whole),
    "slip_px": json_text.or_none(json_text.number),
    "slip_dots": json_text.or_none(json_text.count),
}
"""The facts but for the arrays, by the record's attribute, and what is checked of each."""
TIMES: dict[str, json_text.Check] = {
    "first_pixel_to_result_s": json_text.or_none(json_text.number),
    "last_pixel_to_result_s": json_text.or_none(json_text.number),
    "hardware_time_s": json_text.or_none(json_text.number),
    "host_latency_s": json_text.or_none(json_text.number),
    "made_ns": json_text.whole,
}
"""The attributes of Timing."""
ERRORS = {"errors": json_text.several(json_text.text)}


def encode(record: StreamRecord) -> list[bytes | memoryview]:
    """The parts of a record's message. Raises RecordError for an array of another name, or a number that is
    not finite."""
    arrays, described = [], []
    for name, array in record.arrays.items():
        if name not in ARRAYS:
            raise RecordError(f"array {name!r}: expected some of {', '.join(ARRAYS)}")
        unit, dtype = ARRAYS[name]
        array = np.ascontiguousarray(array, dtype)
        described.append({"name": name, "unit": unit, "dtype": dtype, "shape": array.shape})
        arrays.append(array.reshape(-1).view(np.uint8).data)
    facts = {"format_version": FORMAT_VERSION, **{name: getattr(record, name) for name in SCALARS}}
    timing = {**vars(record.timing), "errors": record.errors}
    try:
        texts = json_text.write({**facts, "arrays": described}), json_text.write(timing)
    except ValueError:
        raise RecordError(f"record of frame {record.frame}: a number is not finite") from None
    return [TOPIC, *texts, *arrays]


def decode(parts: Sequence[bytes | memoryview]) -> StreamRecord:
    """The record in a message; its arrays are views of the message's parts and are not to be changed.

    Raises RecordError, one line, where the message is none or is of another format version.
    """
    if len(parts) < FIXED_PARTS or bytes(parts[0]) != TOPIC:
        raise RecordError(f"message of {len(parts)} parts: no record")
    try:
        facts = json_text.read(parts[1], FORMAT_VERSION)
        scalars = json_text.values(facts, SCALARS)
        when = json_text.read_object(parts[2])
        timing, errors = Timing(**json_text.values(when, TIMES)), json_text.values(when, ERRORS)
    except json_text.JsonError as error:
        raise RecordError(f"record: {error}") from None
    described, octets = facts.get("arrays"), parts[FIXED_PARTS:]
    if not isinstance(described, list) or len(described) != len(octets):
        raise RecordError(f"record: {len(octets)} arrays: not as many as the facts name")
    arrays = dict(_array(one, part) for one, part in zip(described, octets, strict=True))
    if len(arrays) != len(octets):
        raise RecordError("record: an array is there twice")
    return StreamRecord(**scalars, **errors, arrays=arrays, timing=timing)


def _array(described: Any, octets: bytes | memoryview) -> tuple[str, np.ndarray]:
    """Name and values of one array."""
    name = described.get("name") if isinstance(described, dict) else None
    if not isinstance(name, str) or name not in ARRAYS:
        raise RecordError(f"record: array {reprlib.repr(name)}: expected some of {', '.join(ARRAYS)}")
    dtype, shape = np.dtype(ARRAYS[name][1]), described.get("shape")
    is_shape = isinstance(shape, list) and 0 < len(shape) <= MOST_AXES
    if not is_shape or not all(type(n) is int and 0 < n <= MAX_ARRAY_BYTES for n in shape):
        raise RecordError(f"record: array {name}: shape = {reprlib.repr(shape)}")
    if described.get("dtype") != dtype.str or math.prod(shape) * dtype.itemsize != len(octets):
        raise RecordError(f"record: array {name}: {len(octets)} bytes: not {shape} of {dtype.str}")
    return name, np.frombuffer(octets, dtype).reshape(shape)
