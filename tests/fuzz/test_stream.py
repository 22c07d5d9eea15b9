"""Damaged messages of a stream: records, its description, its end."""

import json
from collections.abc import Callable
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from fuzzing import Reader
from hypothesis import strategies as st
from mutations import changed_bytes, changed_tree, texts

from fastac.streaming import about, end, record
from fastac.streaming.about import About, AboutError
from fastac.streaming.end import End, EndError
from fastac.streaming.record import RecordError, StreamRecord, Timing

ARRAYS = {"depth_mm": np.ones((2, 3), np.float32), "image": np.full((2, 2, 3), 9, np.uint8)}
FACTS = {
    "reasons": ("change",),
    "force_n": {"z": 1.5},
    "force_raw": {"z": 2**60},
    "slip_px": 0.5,
    "slip_dots": 3,
}
RECORD = [
    bytes(part)
    for part in record.encode(
        StreamRecord(7, 70, **FACTS, arrays=ARRAYS, timing=Timing(1e-6, 1e-6, 1.0, 1e-3, 9))
    )
]
SENSOR = (
    "s",
    "ab",
    4,
    4,
    ("B", "G", "R"),
    0.1,
    (1, 1),
    ("z",),
    ("depth_mm",),
    ("change",),
    "sim",
    True,
    100.0,
)
ABOUT = about.encode(About(*SENSOR, "data.h5", 100.0))
END = end.encode(End(9))
FRAGMENTS = (b"NaN", b"Infinity", b"1e999", b"9" * 5000, b"[" * 100_000, b'"\\ud800"', b"\xff", b",", b"{}")
KEPT = "part"


def damaged(part: bytes) -> st.SearchStrategy[bytes]:
    """Other JSON than that of a part, and what is none."""
    return texts([json.loads(part)], json.dumps, [part], FRAGMENTS)


@st.composite
def messages(draw, parts: list[bytes], texts_at: tuple[int, ...]) -> dict:
    """A message with one or two parts changed, left out, doubled, or exchanged."""
    found = list(parts)
    for _ in range(draw(st.integers(1, 2))):
        at = draw(st.integers(0, max(len(found) - 1, 0)))
        match draw(st.integers(0, 7)):
            case 0:
                del found[at:]
            case 1:
                found[at:at] = found[at : at + 1]
            case 2 if found:
                other = draw(st.integers(0, len(found) - 1))
                found[at], found[other] = found[other], found[at]
            case 3 if found:
                found[at] = draw(changed_bytes([found[at]], FRAGMENTS))
            case _:
                at = draw(st.sampled_from(texts_at))
                found[at : at + 1] = [draw(damaged(parts[at]))]
    return {f"{KEPT}{k:03d}": part for k, part in enumerate(found)}


def arrays() -> st.SearchStrategy[dict]:
    """Records whose descriptions of arrays were changed."""
    known = json.loads(RECORD[1])
    changed = changed_tree([{"arrays": known["arrays"]}]).map(
        lambda tree: json.dumps({**known, **tree}).encode()
    )
    return changed.map(lambda text: [RECORD[0], text, *RECORD[2:]]).map(
        lambda found: {f"{KEPT}{k:03d}": part for k, part in enumerate(found)}
    )


def read(module, error: type[ValueError]) -> Callable[[Path], None]:
    """What decodes a message; its own errors alone name the folder. What is read can be written again."""

    def decode(folder: Path) -> None:
        parts = [file.read_bytes() for file in sorted(folder.glob(f"{KEPT}*"))]
        try:
            found = module.decode(parts)
        except error as wrong:
            raise ValueError(f"{folder}: {wrong}") from None
        again = module.decode([bytes(part) for part in module.encode(found)])
        assert module.encode(again) == module.encode(found)

    return decode


READERS = [
    Reader(
        "records of a stream",
        st.one_of(messages(RECORD, (1, 2)), arrays()),
        read(record, RecordError),
        quick=100,
    ),
    Reader("description of a stream", messages(ABOUT, (1,)), read(about, AboutError)),
    Reader("end of a stream", messages(END, (1,)), read(end, EndError)),
]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_messages(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)
