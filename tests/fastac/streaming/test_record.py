"""A record to bytes and back, and what is no record."""

import json
import math

import numpy as np
import pytest

from fastac.streaming import record as records
from fastac.streaming.record import RecordError, StreamRecord, Timing


@pytest.fixture
def parts(make_record) -> list[bytes]:
    return [bytes(part) for part in records.encode(make_record(7))]


def changed(parts: list[bytes], part: int, **values) -> list[bytes]:
    """The message with other values in one of its JSON parts."""
    content = json.loads(parts[part]) | values
    return [*parts[:part], json.dumps(content).encode(), *parts[part + 1 :]]


def described(**changes) -> list[dict]:
    """The facts' list of arrays, with one array."""
    return [{"name": "depth_mm", "unit": "mm", "dtype": "<f4", "shape": [2, 3]} | changes]


def same(one: StreamRecord, other: StreamRecord) -> bool:
    return one.digest == other.digest and one.timing == other.timing


def test_a_record_comes_back(make_record, parts):
    back, record = records.decode(parts), make_record(7)
    assert same(back, record)
    assert back.force_raw == {"x": -(2**60) - 1, "z": 2**62 + 3}
    assert (back.reasons, back.errors) == (("change",), ("late",))
    assert back.timing.made_ns == 1_700_000_000_123_456_789
    np.testing.assert_array_equal(back.depth_mm, record.depth_mm)


def test_the_message_is_what_the_module_says(parts):
    assert parts[0] == b"record"
    facts = json.loads(parts[1])
    assert facts["format_version"] == 1
    assert facts["source_time_ns"] == 70_000_000
    assert facts["arrays"] == described()
    assert json.loads(parts[2])["host_latency_s"] == 3e-3
    assert json.loads(parts[2])["errors"] == ["late"]
    assert parts[3] == np.arange(7, 13).astype("<f4").tobytes()


def test_memory_views_are_read_without_a_copy(parts):
    found = records.decode([memoryview(part) for part in parts])
    assert np.shares_memory(found.depth_mm, np.frombuffer(parts[3], np.uint8))


def test_the_digest_is_of_all_but_the_timing(make_record):
    digest = make_record(7).digest
    assert make_record(7, timing=Timing(made_ns=5), errors=()).digest == digest
    other = {"depth_mm": np.zeros((2, 3), np.float32)}
    changes = ({"bad": True}, {"force_n": {"x": -0.5, "z": 1.5}}, {"arrays": {}}, {"arrays": other})
    digests = {make_record(7, **change).digest for change in changes} | {make_record(8).digest, digest}
    assert len(digests) == 6


def test_a_lost_frame_has_no_latency():
    back = records.decode(records.encode(StreamRecord(3, 30, lost=True)))
    assert back.lost
    assert back.timing == Timing()
    assert (back.depth_mm, back.normals, back.force_map_n, back.image) == (None, None, None, None)


def test_arrays_of_any_order_and_byte_order(make_record):
    depth = np.arange(6, dtype=">f8").reshape(3, 2).T
    back = records.decode(records.encode(make_record(1, arrays={"depth_mm": depth})))
    assert back.depth_mm.dtype == np.dtype("<f4")
    np.testing.assert_array_equal(back.depth_mm, depth)


def test_other_languages_may_write_numbers_shorter(parts):
    found = records.decode(changed(parts, 1, force_n={"x": 1}, slip_px=2, slip_dots=9))
    assert (found.force_n, found.slip_px, found.slip_dots) == ({"x": 1.0}, 2.0, 9)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_not_sent(make_record, value):
    for change in ({"force_n": {"z": value}}, {"slip_px": value}, {"timing": Timing(value)}):
        with pytest.raises(RecordError, match="record of frame 7: a number is not finite"):
            records.encode(make_record(7, **change))


def test_an_array_without_a_name_of_ours_is_not_sent(make_record):
    with pytest.raises(RecordError, match="array 'heat': expected some of depth_mm, normals"):
        records.encode(make_record(7, arrays={"heat": np.zeros(3)}))


@pytest.mark.parametrize(
    "facts",
    [
        {"format_version": 2},
        {"format_version": True},
        {"format_version": None},
        {"frame": -1},
        {"frame": 1.0},
        {"frame": True},
        {"frame": 2**63},
        {"source_time_ns": "1"},
        {"lost": 0},
        {"reasons": "change"},
        {"reasons": [1]},
        {"force_n": {"z": "1"}},
        {"force_n": {"z": True}},
        {"force_n": {"z": None}},
        {"force_n": {"z": 10**400}},
        {"force_n": [1.0]},
        {"force_raw": {"z": 1.5}},
        {"slip_px": "1"},
        {"slip_dots": -1},
        {"arrays": None},
        {"arrays": []},
        {"arrays": described() * 2},
        {"arrays": [None]},
        {"arrays": described(name="heat")},
        {"arrays": described(name=[])},
        {"arrays": described(dtype="<f8")},
        {"arrays": described(shape=[3])},
        {"arrays": described(shape=[-2, -3])},
        {"arrays": described(shape=[2, 3.0])},
        {"arrays": described(shape=[2**40, 2**40])},
        {"arrays": described(shape=[6, *[1] * 64])},
        {"arrays": described(shape=[])},
        {"arrays": described(shape=6)},
    ],
    ids=lambda facts: f"{facts!r:.60}",
)
def test_facts_that_are_none(parts, facts):
    with pytest.raises(RecordError, match=r"^record: "):
        records.decode(changed(parts, 1, **facts))


@pytest.mark.parametrize(
    "timing", [{"made_ns": None}, {"made_ns": 1.5}, {"host_latency_s": "x"}, {"errors": None}]
)
def test_times_that_are_none(parts, timing):
    with pytest.raises(RecordError, match=f"record: {next(iter(timing))} = "):
        records.decode(changed(parts, 2, **timing))


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b"[]", b"null", b"\xff", b"[" * 100_000, b'{"frame": NaN}', b'{"a": Infinity}'],
    ids=lambda text: repr(text[:20]),
)
def test_json_that_is_none(parts, text):
    for part in (1, 2):
        with pytest.raises(RecordError, match="record: no JSON"):
            records.decode([*parts[:part], text, *parts[part + 1 :]])


def test_messages_that_are_none(parts):
    for message in ([], parts[:2], [b"about", *parts[1:]]):
        with pytest.raises(RecordError, match=f"message of {len(message)} parts: no record"):
            records.decode(message)
    for message in (parts[:3], [*parts, b""]):
        with pytest.raises(RecordError, match="not as many as the facts name"):
            records.decode(message)
    with pytest.raises(RecordError, match=r"array depth_mm: 23 bytes: not \[2, 3\] of <f4"):
        records.decode([*parts[:3], parts[3][:-1]])


def test_an_array_that_is_there_twice(parts):
    with pytest.raises(RecordError, match="twice"):
        records.decode([*changed(parts, 1, arrays=described() * 2), parts[3]])
