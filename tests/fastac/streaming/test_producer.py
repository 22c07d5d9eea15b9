"""The same frames through emulator, Verilated simulation and the stand-ins of boards: the same records."""

import itertools

import numpy as np
import pytest

from fastac.driver.driver import Driver
from fastac.streaming import clock, producer
from fastac.streaming import record as records
from fastac.streaming.client import connect

SOURCES = ("emulator", "simulation", "uio", "pynq")
ARRAYS = ("depth_mm", "image")


def streamed(driver: Driver, frames: np.ndarray, **settings) -> list[records.StreamRecord]:
    return list(producer.records(driver, clock.recorded(frames), arrays=ARRAYS, **settings))


@pytest.fixture
def reference(opened, description, frames) -> list[records.StreamRecord]:
    """What comes out of the emulator."""
    with opened("emulator") as transport:
        return streamed(Driver(transport, description), frames)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.quick("emulator", "uio", "pynq")
def test_every_source_gives_the_same_records(opened, description, frames, reference, source):
    """In this process and out of the socket; all bytes but those of the timing."""
    with opened(source) as transport:
        found = streamed(Driver(transport, description), frames)
    assert [one.digest for one in found] == [one.digest for one in reference]
    for one, other in zip(found, reference, strict=True):
        ours, theirs = (records.encode(record) for record in (one, other))
        assert [bytes(part) for k, part in enumerate(ours) if k != 2] == [
            bytes(part) for k, part in enumerate(theirs) if k != 2
        ]


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.quick("emulator", "uio", "pynq")
def test_every_source_gives_the_same_records_through_the_socket(
    opened, description, frames, reference, publisher, source
):
    with opened(source) as transport, connect(publisher.address) as stream:
        driver = Driver(transport, description)
        for sent in producer.records(driver, clock.recorded(frames), arrays=ARRAYS):
            publisher.add(sent)
            received = next(stream)
            assert received.digest == sent.digest == reference[sent.frame].digest
            assert received.timing == sent.timing
        publisher.close()
        assert list(stream) == []
    assert (stream.received, stream.missed) == (len(frames), 0)


def test_records_are_what_the_emulator_finds(reference, frames, expected, bundle):
    for k, found in enumerate(reference):
        assert found.frame == k
        assert found.source_time_ns == k * 10_000_000
        assert list(found.force_raw.values()) == expected.force_raw[k].tolist()
        assert found.suspect == bool(expected.validity[k])
        np.testing.assert_array_equal(found.depth_mm, expected.depth_mm[k, 1:-1, 1:-1])
        np.testing.assert_array_equal(found.image, frames[k])
    assert {one.suspect for one in reference} == {True, False}


def test_the_number_in_flight_changes_nothing(opened, description, frames, reference):
    with opened("emulator") as transport:
        found = streamed(Driver(transport, description), frames, in_flight=1)
    assert [one.digest for one in found] == [one.digest for one in reference]


def test_a_lost_frame_is_a_record(opened, description, frames, reference, monkeypatch):
    """Its number and time stamp are right, and so are those of the next ones."""
    with opened("emulator") as transport:
        receive, count = transport.receive, itertools.count(1)

        def unreliable(stream: str, timeout_s: float) -> np.ndarray:
            packet = receive(stream, timeout_s)
            return receive(stream, timeout_s) if next(count) == 3 else packet

        monkeypatch.setattr(transport, "receive", unreliable)
        found = streamed(Driver(transport, description), frames)
    assert [one.frame for one in found if one.lost] == [2]
    assert found[2].source_time_ns == 20_000_000
    assert found[2].force_n == {}
    assert list(found[2].arrays) == ["image"]
    assert [one.digest for one in found if not one.lost] == [
        one.digest for one in reference if one.frame != 2
    ]


def test_arrays_that_the_hardware_does_not_find(opened, description, frames):
    with opened("emulator") as transport:
        driver = Driver(transport, description)
        assert producer.available(description) == ("depth_mm", "image")
        with pytest.raises(ValueError, match="array 'normals': this stream can have depth_mm, image"):
            next(producer.records(driver, clock.recorded(frames), arrays=("normals",)))
