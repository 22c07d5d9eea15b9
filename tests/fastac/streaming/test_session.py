"""A stream from a bundle and a dataset: its records are what the emulator finds."""

import numpy as np
import pytest

from fastac.models.emulator.pipeline import Emulator
from fastac.streaming import record as records
from fastac.streaming.session import open_session


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
