"""The description of a stream, and its end, to bytes and back."""

import json

import pytest

from fastac.streaming import about as descriptions
from fastac.streaming import end
from fastac.streaming.about import AboutError
from fastac.streaming.end import End, EndError


def test_a_description_comes_back(about):
    parts = descriptions.encode(about)
    assert parts[0] == b"about"
    assert json.loads(parts[1])["units"]["force_n"] == "N"
    assert descriptions.decode(parts) == about


@pytest.mark.parametrize(
    "change",
    [
        {"format_version": 2},
        {"scene": None},
        {"height_px": -1},
        {"channels": "BGR"},
        {"pitch_mm": "0.25"},
        {"force_axes": [1]},
        {"simulated_clock": 1},
        {"clock_mhz": 10**400},
        {"frames_per_second": []},
    ],
    ids=repr,
)
def test_descriptions_that_are_none(about, change):
    topic, text = descriptions.encode(about)
    content = json.loads(text) | change
    with pytest.raises(AboutError, match=f"description of a stream: {next(iter(change))} = "):
        descriptions.decode([topic, json.dumps(content).encode()])


def test_messages_that_describe_nothing(about):
    topic, text = descriptions.encode(about)
    for parts in ([], [topic], [b"record", text], [topic, text, b""]):
        with pytest.raises(AboutError, match="describes no stream"):
            descriptions.decode(parts)
    for bad in (b"", b"[]", b"[" * 100_000):
        with pytest.raises(AboutError, match="description of a stream: no JSON"):
            descriptions.decode([topic, bad])


def test_an_end_comes_back():
    assert end.decode(end.encode(End(12))) == End(12)


def test_messages_that_are_no_end():
    for parts in ([], [b"record", b"{}"]):
        with pytest.raises(EndError, match="not the end of a stream"):
            end.decode(parts)
    for text in (b"", b'{"format_version":1}', b'{"format_version":1,"frames":-1}', b'{"format_version":2}'):
        with pytest.raises(EndError, match="end of a stream: "):
            end.decode([end.TOPIC, text])
