"""The LeRobot package reads of every message what `fastac.streaming` reads."""

import json
from dataclasses import asdict, fields

import numpy as np
import pytest
from records_by_hand import ABOUT, a_record, sent

from fastac.streaming import about as abouts
from fastac.streaming import record as records
from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord, Timing


def test_there_are_the_same_fields(messages):
    for ours, theirs in (
        (StreamRecord, messages.Record),
        (Timing, messages.Timing),
        (About, messages.About),
    ):
        assert {one.name for one in fields(theirs)} == {one.name for one in fields(ours)}
    assert {name: dtype for name, (_, dtype) in records.ARRAYS.items()} == messages.DTYPES
    assert (messages.ABOUT, messages.RECORD) == (abouts.TOPIC, records.TOPIC)
    assert records.FORMAT_VERSION == abouts.FORMAT_VERSION == messages.FORMAT_VERSION


def test_the_end_has_the_same_name(messages):
    end = pytest.importorskip("fastac.streaming.end")
    assert messages.decode(sent(end.encode(end.End(7)))) is None
    assert end.TOPIC == messages.END


def test_a_description_is_the_same(messages):
    assert asdict(messages.decode(sent(abouts.encode(ABOUT)))) == asdict(ABOUT)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="full"),
        pytest.param({"arrays": {}, "force_n": {}, "force_raw": {}, "slip_px": None}, id="nothing-found"),
        pytest.param({"lost": True, "timing": Timing(made_ns=5), "force_n": {}}, id="lost"),
    ],
)
def test_a_record_is_the_same(messages, changes):
    record = a_record(**changes)
    parts = sent(records.encode(record))
    expected, found = records.decode(parts), messages.decode(parts)
    for one in fields(StreamRecord):
        if one.name not in ("arrays", "timing"):
            assert getattr(found, one.name) == getattr(expected, one.name), one.name
    assert vars(found.timing) == vars(expected.timing)
    assert list(found.arrays) == list(expected.arrays)
    for name, array in expected.arrays.items():
        assert found.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(found.arrays[name], array)


def test_messages_of_other_kinds_are_passed_over(messages):
    assert messages.decode([b"later", b"{}"]) is None
    assert messages.decode([]) is None


def changed(part: bytes, **changes) -> bytes:
    return json.dumps({**json.loads(part), **changes}).encode()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda p: p[:2], "record of 2 parts: expected 3 or more"),
        (lambda p: p[:-1], "record: arrays: not as many as sent"),
        (lambda p: [*p[:3], p[3][:-4], *p[4:]], "record: array depth_mm: 92 bytes: not [4, 6] of <f4"),
        (lambda p: [p[0], b"{", *p[2:]], "record: no JSON"),
        (lambda p: [p[0], b"[]", *p[2:]], "record: no JSON object"),
        (
            lambda p: [p[0], changed(p[1], format_version=2), *p[2:]],
            "record: format_version = 2: this reads 1",
        ),
        (lambda p: [p[0], changed(p[1], frame=True), *p[2:]], "record: frame = True: of another type"),
        (lambda p: [p[0], changed(p[1], force_n=[]), *p[2:]], "record: force_n = []: of another type"),
        (
            lambda p: [p[0], changed(p[1], arrays=[{"name": []}] * 4), *p[2:]],
            "record: array []: expected some",
        ),
        (lambda p: [*p[:2], b"{}", *p[3:]], "timing: first_pixel_to_result_s: missing"),
    ],
)
def test_a_damaged_message_is_refused_in_one_line(messages, damage, message):
    with pytest.raises(messages.MessageError) as found:
        messages.decode(damage(sent(records.encode(a_record()))))
    assert str(found.value).startswith(message)
    assert "\n" not in str(found.value)
