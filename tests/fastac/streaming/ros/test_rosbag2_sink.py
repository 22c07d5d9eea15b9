"""rosbag2 folders: what `rosbags` reads back is what the records were, and what is left after a kill."""

import json

import pytest

pytest.importorskip("mcap", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")

from ros_messages import assert_same, frames_in
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from fastac.streaming.ros.log_files import LogError
from fastac.streaming.ros.messages import Messages
from fastac.streaming.ros.rosbag2_sink import STORAGES, Rosbag2Sink


def write(folder, about, records, **options) -> None:
    sink = Rosbag2Sink(folder, Messages(about, frame_id="left"), **options)
    for record in records:
        sink.add(record)
    sink.close()


@pytest.fixture(params=list(STORAGES))
def storage(request):
    return request.param


@pytest.fixture
def folder(about, records, storage, tmp_path):
    write(tmp_path / "bag", about, records, storage=storage)
    return tmp_path / "bag"


def test_rosbags_reads_back_every_value(folder, about, records):
    found: dict[int, dict] = {}
    with AnyReader([folder]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(time_ns, {})[connection.topic.removeprefix("/fastac/")] = message
        assert reader.start_time == records[0].source_time_ns
    assert list(found) == [record.source_time_ns for record in records]
    for record in records:
        assert_same(found[record.source_time_ns], record, about, "left")


def test_publishers_are_offered_as_reliable(folder):
    with AnyReader([folder]) as reader:
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            assert (qos.reliability, qos.durability) == (QosReliability.RELIABLE, QosDurability.VOLATILE)
            assert (qos.history, qos.depth) == (QosHistory.KEEP_LAST, 10)


def test_the_folder_says_what_sensor_it_is_of(folder, about):
    reader = DirectoryReader(folder)
    reader.open()
    said = reader.metadata.custom
    reader.close()
    assert said["bundle_sha256"] == about.bundle_sha256
    assert said["frame_id"] == "left"
    assert said["unit of /fastac/points"] == "m"
    assert json.loads(said["about"])["pitch_mm"] == about.pitch_mm


def test_what_was_flushed_is_in_the_file_after_a_kill(about, records, storage, tmp_path, monkeypatch):
    monkeypatch.setattr("fastac.streaming.ros.rosbag2_sink.FLUSH_S", -1.0)
    sink = Rosbag2Sink(tmp_path / "bag", Messages(about), storage=storage)
    for record in records:
        sink.add(record)
    (path,) = (tmp_path / "bag").iterdir()  # no metadata.yaml yet
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes())
    if storage == "mcap":
        assert frames_in(copy) == [0, 1, 2]
    else:
        reader = Sqlite3Reader(copy)
        reader.open()
        topics = [connection.topic for connection, _, _ in reader.messages(reader.connections)]
        reader.close()
        assert topics.count("/fastac/status") == len(records)
    sink.close()


def test_a_log_is_replaced_only_when_asked_to(folder, about, records, storage):
    with pytest.raises(LogError, match=r"bag: exists already; --force replaces it"):
        write(folder, about, records, storage=storage)
    write(folder, about, records[:1], storage=storage, force=True)
    with AnyReader([folder]) as reader:
        assert {time_ns for _, time_ns, _ in reader.messages()} == {records[0].source_time_ns}


def test_a_folder_with_anything_else_is_never_removed(about, records, tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "notes.yaml").write_text("mine")
    with pytest.raises(LogError, match=r"bag: holds notes\.yaml, which is no part of a log: not replaced"):
        write(tmp_path / "bag", about, records, force=True)
    assert (tmp_path / "bag" / "notes.yaml").read_text() == "mine"
