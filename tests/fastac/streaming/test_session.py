"""A stream from a bundle and a dataset: its records are what the emulator finds."""

from itertools import islice

import numpy as np
import pytest

from fastac.driver.run import Stop
from fastac.models.emulator.pipeline import Emulator
from fastac.streaming import record as records
from fastac.streaming.session import open_session, repeated


@pytest.fixture
def session(tiny_folder, tiny_file):
    with open_session(tiny_folder, str(tiny_file), frames_per_second=50) as opened:
        yield opened


def test_records_are_what_the_emulator_finds(session, tiny_bundle, tiny_data):
    pipeline = tiny_bundle.pipeline.replace(background=tiny_data.background)
    expected = Emulator(pipeline).run(tiny_data.frames)
    found = list(session.records())
    assert [one.frame for one in found] == list(range(len(tiny_data.frames)))
    assert [one.source_time_ns for one in found] == [k * 20_000_000 for k in range(len(found))]
    np.testing.assert_array_equal([one.depth_mm for one in found], expected.depth_mm[:, 1:-1, 1:-1])
    np.testing.assert_array_equal([one.image for one in found], tiny_data.frames)
    np.testing.assert_array_equal([one.force_raw["z"] for one in found], expected.force_raw[:, 0])
    assert session.about.arrays == ("depth_mm", "normals", "image")


def test_records_are_the_same_with_any_number_in_flight(session):
    one, many = (list(session.records(frames=6, in_flight=n)) for n in (1, None))
    assert [record.digest for record in one] == [record.digest for record in many]


def test_a_record_comes_back_from_its_bytes(session):
    (record,) = session.records(frames=1)
    back = records.decode([bytes(part) for part in records.encode(record)])
    assert back.digest == record.digest
    assert back.timing == record.timing


def test_a_looped_recording_begins_again(tiny_folder, tiny_file, tiny_data):
    """Numbers and time stamps go on."""
    count = len(tiny_data.frames)
    with open_session(tiny_folder, str(tiny_file), arrays=("image",), loop=True) as opened:
        found = list(opened.records(frames=count + 2))
    assert [one.frame for one in found] == list(range(count + 2))
    assert found[-1].source_time_ns == (count + 1) * 10_000_000
    np.testing.assert_array_equal(found[count].image, tiny_data.frames[0])
    np.testing.assert_array_equal(found[count + 1].image, tiny_data.frames[1])


def test_long_recordings_are_opened_again_and_short_ones_are_kept():
    frames, opened = [np.zeros(10, np.uint8)] * 3, []

    def again():
        opened.append(1)
        return frames

    assert len(list(islice(repeated(iter(frames), again, most_bytes=30), 8))) == 8
    assert opened == []
    assert len(list(islice(repeated(iter(frames), again, most_bytes=29), 8))) == 8
    assert len(opened) == 2


def test_no_frames_are_not_looked_for_forever():
    assert list(repeated([], list)) == []


def test_a_stop_ends_the_stream_after_the_frames_in_flight(session):
    stop, found = Stop(), []
    for record in session.records(in_flight=3, stop=stop):
        found.append(record.frame)
        stop.asked = record.frame == 1 or stop.asked
    assert found == [0, 1, 2, 3, 4]  # the last one was taken from its source already


def test_arrays_that_are_not_there_are_refused_at_once(tiny_folder, tiny_file):
    with (
        pytest.raises(ValueError, match="array 'force_map_n': this stream can have depth_mm, normals, image"),
        open_session(tiny_folder, str(tiny_file), arrays=("force_map_n",)),
    ):
        pass
