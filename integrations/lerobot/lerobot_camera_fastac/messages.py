"""The messages of a FasTac stream, read with NumPy and nothing else.

`fastac serve` sends messages of several parts; the first names the kind:

    b"about"    JSON: sensor, geometry, units, what computes
    b"record"   JSON: what was found in a frame; JSON: timing and the errors that stood in the hardware's
                register; then the arrays, C order, little-endian
    b"end"      JSON: no further record will come

This file is used without FasTac, whose libraries LeRobot cannot have beside it; FasTac's tests compare every
field with what FasTac itself reads.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

ABOUT, RECORD, END = b"about", b"record", b"end"
FORMAT_VERSION = 1
DTYPES = {"depth_mm": "<f4", "normals": "<f4", "force_map_n": "<f4", "image": "|u1"}


class MessageError(ValueError):
    """A message that is not of a stream, or of another version; the message is one line."""


@dataclass(frozen=True)
class About:
    """A stream's description.

    height_px, width_px, channels : of a frame; pitch_mm : between the centres of two pixels
    depth_origin_px : (row, column) of the image where depth and force map begin: they are without the rim
    force_axes : the axes of the force, () where none is found
    arrays : the names of the arrays that records have; validity : all reasons for a suspect frame
    via : what computes; simulated_clock : whether latencies are counted by a simulated clock
    frames_per_second : of the source, None where it is not known
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
    frames_per_second: float | None


@dataclass(frozen=True)
class Timing:
    """Latencies of a record in s, None for a lost frame, and when it was made, ns since 1970."""

    first_pixel_to_result_s: float | None
    last_pixel_to_result_s: float | None
    hardware_time_s: float | None
    host_latency_s: float | None
    made_ns: int


@dataclass(frozen=True, eq=False)
class Record:
    """What was found in one frame; `fastac/streaming/record.py` says what each field means.

    force_n : newtons by axis; z is positive in compression
    arrays : depth_mm (H - 2, W - 2), height of the skin, which pressing lowers; force_map_n
        (axes, H - 2, W - 2); normals (H, W, 3); image (H, W, C) uint8
    """

    frame: int
    source_time_ns: int
    lost: bool
    bad: bool
    suspect: bool
    slipping: bool
    reasons: tuple[str, ...]
    errors: tuple[str, ...]
    force_n: dict[str, float]
    force_raw: dict[str, int]
    slip_px: float | None
    slip_dots: int | None
    timing: Timing
    arrays: dict[str, np.ndarray] = field(default_factory=dict)


def decode(parts: Sequence[bytes]) -> About | Record | None:
    """What a message holds: the stream's description, a record, or None for any other kind of message.

    A record's arrays are read-only views of the message. Raises MessageError, one line.
    """
    kind = bytes(parts[0]) if parts else b""
    if kind == ABOUT:
        _expect(len(parts) == 2, f"description of {len(parts)} parts: expected 2")
        content = _versioned(parts[1], "description")
        return About(**_fields(About, content, "description"))
    if kind == RECORD:
        return _record(parts)
    return None


def _record(parts: Sequence[bytes]) -> Record:
    _expect(len(parts) >= 3, f"record of {len(parts)} parts: expected 3 or more")
    facts, octets = _versioned(parts[1], "record"), parts[3:]
    when = _json(parts[2], "timing")
    timing = Timing(**_fields(Timing, when, "timing"))
    _expect(isinstance(when.get("errors"), list), "timing: errors: missing, or no list")
    described = facts.get("arrays")
    _expect(
        isinstance(described, list) and len(described) == len(octets), "record: arrays: not as many as sent"
    )
    arrays = dict(_array(one, part) for one, part in zip(described, octets, strict=True))
    return Record(
        **_fields(Record, {**facts, "errors": when["errors"], "timing": timing, "arrays": arrays}, "record")
    )


def _array(described: Any, octets: bytes) -> tuple[str, np.ndarray]:
    name = described.get("name") if isinstance(described, dict) else None
    _expect(
        isinstance(name, str) and name in DTYPES,
        f"record: array {name!r}: expected some of {', '.join(DTYPES)}",
    )
    dtype, shape = np.dtype(DTYPES[name]), described.get("shape")
    whole = isinstance(shape, list) and all(type(n) is int and n > 0 for n in shape)
    _expect(whole, f"record: array {name}: shape = {shape!r}")
    there = memoryview(octets).nbytes
    fits = described.get("dtype") == dtype.str and there == math.prod(shape) * dtype.itemsize
    _expect(fits, f"record: array {name}: {there} bytes: not {shape} of {dtype.str}")
    return name, np.frombuffer(octets, dtype).reshape(shape)


def _fields(kind: type, content: dict, what: str) -> dict[str, Any]:
    """Of the content what a dataclass has, each of its type; lists become tuples."""
    found = {}
    for name, hint in get_type_hints(kind).items():
        _expect(name in content, f"{what}: {name}: missing")
        value = content[name]
        _expect(_is(value, hint), f"{what}: {name} = {value!r}: of another type")
        found[name] = tuple(value) if isinstance(value, list) else value
    return found


def _is(value: Any, hint: Any) -> bool:
    """Whether a value of JSON can be of an annotated type; items of lists and objects are not looked at."""
    if get_origin(hint) is UnionType:
        return any(_is(value, one) for one in get_args(hint))
    kind = {tuple: list, float: (float, int)}.get(get_origin(hint) or hint, get_origin(hint) or hint)
    return isinstance(value, kind) and not (isinstance(value, bool) and hint in (int, float))


def _versioned(part: bytes, what: str) -> dict:
    content = _json(part, what)
    version = content.get("format_version")
    _expect(version == FORMAT_VERSION, f"{what}: format_version = {version!r}: this reads {FORMAT_VERSION}")
    return content


def _json(part: bytes, what: str) -> dict:
    try:
        content = json.loads(bytes(part))
    except ValueError:
        raise MessageError(f"{what}: no JSON") from None
    _expect(isinstance(content, dict), f"{what}: no JSON object")
    return content


def _expect(held: bool, message: str) -> None:
    if not held:
        raise MessageError(message)
