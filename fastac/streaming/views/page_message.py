"""The messages that the page in a browser gets: binary, several parts in one.

    number of parts, and the length of each: uint32, little-endian; then the parts

    b"about"   the stream's description (JSON of about.py), what the page draws with (JSON), skin at rest
    b"record"  facts and timing (JSON, parts 1 and 2 of record.py), what is drawn (JSON), arrays

Arrays are thinned to what a page can show, and normals are sent as colours.
"""

import struct
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fastac.streaming import about as descriptions
from fastac.streaming import json_text
from fastac.streaming import record as records
from fastac.streaming.record import StreamRecord
from fastac.streaming.views.pictures import RAMP, SURFACE_PX, Sight, colours_of_normals, thinned

IMAGE_PX = 128
"""Most rows and columns of an image that is shown."""
Parts = list[bytes | memoryview]


def joined(parts: Sequence[bytes | memoryview]) -> bytes:
    """The parts as one message."""
    return b"".join([struct.pack(f"<{len(parts) + 1}I", len(parts), *map(len, parts)), *parts])


def split(message: bytes) -> list[bytes]:
    """The parts of a message, as the page takes them apart."""
    (count,) = struct.unpack_from("<I", message)
    parts, at = [], 4 * (count + 1)
    for length in struct.unpack_from(f"<{count}I", message, 4):
        parts.append(message[at : at + length])
        at += length
    return parts


def of_about(sight: Sight) -> bytes:
    """The description of the stream."""
    rest = np.ascontiguousarray(thinned(sight.rest_depth_mm, SURFACE_PX), "<f4")
    x, y = (axis.tolist() for axis in sight.grid_mm())
    drawn = {"ramp": RAMP.tolist(), "x_mm": x, "y_mm": y, "arrays": [_described("rest_mm", rest)]}
    return joined([*descriptions.encode(sight.about), json_text.write(drawn), rest.tobytes()])


def of_record(sight: Sight, record: StreamRecord) -> tuple[Parts, dict, Parts]:
    """Facts and timing; what is drawn, to which the page's own counts are added; arrays."""
    press = sight.press_mm(record)
    sight.see(record, press)
    arrow = sight.arrow(record, press)
    arrays = {}
    if record.image is not None:
        arrays["image"] = thinned(record.image, IMAGE_PX)
    if record.normals is not None:
        arrays["normals_rgb"] = colours_of_normals(thinned(record.normals, IMAGE_PX))
    if record.depth_mm is not None:
        arrays["depth_mm"] = thinned(record.depth_mm, SURFACE_PX).astype("<f4")
    if record.force_map_n is not None:
        arrays["force_map_n"] = thinned(record.force_map_n[-1], SURFACE_PX).astype("<f4")
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    drawn = {
        "arrays": [_described(name, array) for name, array in arrays.items()],
        "deepest_mm": None if press is None else float(press.max()),
        "full_press_mm": sight.full_press_mm,
        "full_force_n": sight.full_force_n,
        "full_shear_n": sight.full_shear_n,
        "arrow": None
        if arrow is None
        else {"tip_mm": arrow.tip_mm.tolist(), "vector_mm": arrow.vector_mm.tolist()},
    }
    facts = records.encode(replace(record, arrays={}))
    return facts, drawn, [array.reshape(-1).view(np.uint8).data for array in arrays.values()]


def _described(name: str, array: np.ndarray) -> dict:
    return {"name": name, "dtype": array.dtype.str, "shape": array.shape}
