"""MCAP files: what `mcap` and `rosbags` read back is what the records were, also after a kill."""

import json
from dataclasses import asdict

import pytest

pytest.importorskip("mcap", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from ros_messages import assert_same, frames_in
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore

from fastac.streaming.ros.log_files import LogError
from fastac.streaming.ros.mcap_sink import McapSink
from fastac.streaming.ros.messages import Messages


@pytest.fixture
def written(about, records, tmp_path):
    """A log of the records, closed."""
    path = tmp_path / "log.mcap"
    sink = McapSink(path, Messages(about))
    for record in records:
        sink.add(record)
    sink.close()
    return path


def by_time(triples) -> dict[int, dict]:
    """Messages by the log's time and by topic."""
    found: dict[int, dict] = {}
    for topic, time_ns, message in triples:
        found.setdefault(time_ns, {})[topic.removeprefix("/fastac/")] = message
    return found


def decoded(reader):
    for _, channel, message, content in reader.iter_decoded_messages():
        assert message.publish_time == message.log_time
        yield channel.topic, message.log_time, content


def test_mcap_reads_back_every_value(written, about, records):
    with written.open("rb") as file:
        found = by_time(decoded(make_reader(file, decoder_factories=[DecoderFactory()])))
    assert list(found) == [record.source_time_ns for record in records]
    for record in records:
        assert_same(found[record.source_time_ns], record, about, "fastac_fingertip")


def test_rosbags_reads_back_every_value(written, about, records):
    types = get_typestore(Stores.ROS2_HUMBLE)
    reader = McapReader(written)
    reader.open()
    found = by_time(
        (connection.topic, time_ns, types.deserialize_cdr(data, connection.msgtype))
        for connection, time_ns, data in reader.messages(reader.connections)
    )
    reader.close()
    for record in records:
        assert_same(found[record.source_time_ns], record, about, "fastac_fingertip")


def test_the_file_says_what_sensor_it_is_of(written, about):
    with written.open("rb") as file:
        reader = make_reader(file)
        (metadata,) = reader.iter_metadata()
        channels = reader.get_summary().channels.values()
    assert metadata.name == "fastac"
    said = json.loads(metadata.metadata["about"])
    for name, value in asdict(about).items():
        assert said[name] == (list(value) if isinstance(value, tuple) else value)
    assert metadata.metadata["bundle_sha256"] == about.bundle_sha256
    assert metadata.metadata["frame_id"] == "fastac_fingertip"
    assert metadata.metadata["unit of /fastac/wrench"] == "N"
    assert metadata.metadata["unit of /fastac/depth"] == "m"
    for channel in channels:
        (qos,) = parse_qos(channel.metadata["offered_qos_profiles"])
        assert (qos.reliability, qos.durability) == (QosReliability.RELIABLE, QosDurability.VOLATILE)
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")


def after_a_cut(path, octets: int) -> list[int]:
    """Numbers of the frames that are in a file which was cut to that length."""
    cut = path.with_name("cut.mcap")
    cut.write_bytes(path.read_bytes()[:octets])
    return frames_in(cut)


def test_what_was_flushed_is_read_after_a_kill(about, records, tmp_path, monkeypatch):
    monkeypatch.setattr("fastac.streaming.ros.mcap_sink.FLUSH_S", -1.0)
    path = tmp_path / "log.mcap"
    sink = McapSink(path, Messages(about))
    sizes = []
    for record in records:
        sink.add(record)
        sizes.append(path.stat().st_size)
    assert after_a_cut(path, sizes[-1]) == [0, 1, 2]
    sink.close()
    whole = path.stat().st_size
    for octets in (sizes[0], sizes[0] + 1, sizes[1] - 1, sizes[1], (sizes[1] + sizes[2]) // 2, whole - 1):
        complete = sum(size <= octets for size in sizes)
        assert after_a_cut(path, octets)[:complete] == list(range(complete))


def test_a_file_is_replaced_only_when_asked_to(written, about, records):
    before = written.read_bytes()
    with pytest.raises(LogError, match=r"log\.mcap: exists already; --force replaces it"):
        McapSink(written, Messages(about))
    assert written.read_bytes() == before
    sink = McapSink(written, Messages(about), force=True, namespace="/left/finger")
    sink.add(records[0])
    sink.close()
    with written.open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert "/left/finger/status" in topics
    assert not {topic for topic in topics if topic.startswith("/fastac")}


@pytest.mark.parametrize("namespace", ["fastac", "/", "/1st", "/a b", "/a/"])
def test_namespaces_that_ros_does_not_have_are_refused(namespace, about, tmp_path):
    with pytest.raises(LogError, match=r"namespace .*: expected names such as /fastac or /left/finger"):
        McapSink(tmp_path / "log.mcap", Messages(about), namespace=namespace)
    assert not (tmp_path / "log.mcap").exists()


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_each_compression_reads_back(compression, about, records, tmp_path):
    path = tmp_path / "log.mcap"
    sink = McapSink(path, Messages(about), compression=compression)
    sink.add(records[0])
    sink.close()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert {index.compression or "none" for index in reader.get_summary().chunk_indexes} == {compression}
        assert_same(
            by_time(decoded(reader))[records[0].source_time_ns], records[0], about, "fastac_fingertip"
        )
