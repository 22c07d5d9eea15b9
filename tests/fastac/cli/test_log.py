"""`fastac log`: a stream of a bundle, or of a server, into MCAP and rosbag2; one line for what cannot be."""

import importlib.util

import pytest

pytest.importorskip("mcap", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")

from command_line import fail, run, succeed
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from offered import offered
from ros_messages import assert_same, frames_in
from rosbags.highlevel import AnyReader

from fastac.streaming.session import open_session


@pytest.fixture
def streamed(tiny_folder, tiny_file):
    """The description and the records of the stream that is logged."""
    with open_session(tiny_folder, str(tiny_file)) as session:
        return session.about, list(session.records(frames=4))


def in_mcap(path) -> dict[int, dict]:
    """The messages of an MCAP file by time and by topic."""
    found: dict[int, dict] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(message.log_time, {})[channel.topic] = content
    return found


def in_rosbag2(folder) -> dict[int, dict]:
    found: dict[int, dict] = {}
    with AnyReader([folder]) as reader:
        for connection, time_ns, data in reader.messages():
            content = reader.deserialize(data, connection.msgtype)
            found.setdefault(time_ns, {})[connection.topic] = content
    return found


def assert_logged(found: dict[int, dict], records, about, frame_id="fastac_fingertip", namespace="/fastac"):
    """All but the timing, which is another in each run, is that of the records."""
    assert list(found) == [record.source_time_ns for record in records]
    for record in records:
        messages = {
            topic.removeprefix(f"{namespace}/"): message
            for topic, message in found[record.source_time_ns].items()
        }
        assert_same(messages, record, about, frame_id, timing=False)


def test_a_stream_is_logged_to_both_forms(tiny_folder, tiny_file, streamed, tmp_path):
    about, records = streamed
    mcap, bag = tmp_path / "logs" / "touch.mcap", tmp_path / "touch"
    result = succeed(
        *("log", tiny_folder, "--source", tiny_file, "--frames", 4, "--no-progress"),
        *("--mcap", mcap, "--rosbag2", bag),
    )
    lines = result.stdout.splitlines()
    assert lines[0].startswith("4 frames in ")
    assert lines[1:] == [str(mcap), str(bag)]
    assert_logged(in_mcap(mcap), records, about)
    assert_logged(in_rosbag2(bag), records, about)


def test_options_say_frame_topics_and_arrays(tiny_folder, tiny_file, streamed, tmp_path):
    _, records = streamed
    succeed(
        *("log", tiny_folder, "--source", tiny_file, "--frames", 4, "--no-progress", "--arrays", "none"),
        *("--fps", 50, "--rosbag2", tmp_path / "bag", "--storage", "sqlite3"),
        *("--frame-id", "left_tip", "--namespace", "/left/tip", "--unmeasured", "zero"),
    )
    found = in_rosbag2(tmp_path / "bag")
    assert list(found) == [k * 20_000_000 for k in range(4)]
    for messages, record in zip(found.values(), records, strict=True):
        assert set(messages) == {"/left/tip/wrench", "/left/tip/status"}
        wrench = messages["/left/tip/wrench"]
        assert wrench.header.frame_id == "left_tip"
        force = wrench.wrench.force
        assert (force.x, force.y, force.z) == (0.0, 0.0, record.force_n["z"])
    assert [path.suffix for path in sorted((tmp_path / "bag").iterdir())] == [".db3", ".yaml"]


def test_a_stream_of_a_server_is_logged(streamed, tmp_path):
    about, records = streamed
    with offered(about, records) as address:
        result = succeed("log", "--from", address, "--mcap", tmp_path / "touch.mcap", "--no-progress")
    assert result.stdout.startswith("4 frames in ")
    assert result.stderr == ""
    assert_logged(in_mcap(tmp_path / "touch.mcap"), records, about)


def test_records_that_were_missed_are_counted(streamed, tmp_path):
    about, records = streamed
    with offered(about, [records[0], records[3]]) as address:
        result = succeed("log", "--from", address, "--mcap", tmp_path / "touch.mcap", "--no-progress")
    assert result.stderr == "2 records were missed: the log was slower than the stream\n"
    assert frames_in(tmp_path / "touch.mcap") == [0, 3]


def test_logs_are_replaced_only_when_asked_to(tiny_folder, tiny_file, tmp_path):
    mcap, bag = tmp_path / "touch.mcap", tmp_path / "touch"
    words = ("log", tiny_folder, "--source", tiny_file, "--no-progress", "--mcap", mcap, "--rosbag2", bag)
    succeed(*words, "--frames", 2)
    assert fail(*words) == f"{mcap}: exists already; --force replaces it"
    mcap.unlink()
    assert fail(*words) == f"{bag}: exists already; --force replaces it"
    (bag / "mine.txt").write_text("mine")
    assert fail(*words, "--force") == f"{bag}: holds mine.txt, which is no part of a log: not replaced"
    assert not mcap.exists()
    (bag / "mine.txt").unlink()
    succeed(*words, "--frames", 3, "--force")
    assert frames_in(mcap) == [0, 1, 2]
    assert len(in_rosbag2(bag)) == 3


def test_what_cannot_be_is_one_line(tiny_folder, tiny_file, tmp_path, monkeypatch):
    mcap = ("--mcap", tmp_path / "touch.mcap")
    assert fail("log", tiny_folder) == "nothing to write: give --mcap FILE or --rosbag2 FOLDER"
    assert fail("log", *mcap) == "no stream: give a BUNDLE, or --from the address of `fastac serve`"
    address = "tcp://127.0.0.1:9"
    told = f"not together with --from: {address} has a stream of its own"
    assert fail("log", tiny_folder, "--from", address, *mcap) == f"BUNDLE: {told}"
    assert fail("log", "--from", address, "--via", "sim", *mcap) == f"--via: {told}"
    assert fail("log", "--from", "127.0.0.1", *mcap).startswith("127.0.0.1: expected an address")
    assert "namespace 'tip'" in fail("log", tiny_folder, *mcap, "--namespace", "tip")
    found = fail("log", tiny_folder, "--source", tiny_file, "--arrays", "force_map_n", *mcap)
    assert found.startswith("array 'force_map_n'")
    assert not (tmp_path / "touch.mcap").exists()
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "fastac.streaming.ros.log_files.find_spec", lambda name: None if name == "mcap" else find(name)
    )
    assert fail("log", tiny_folder, *mcap) == "logs for ROS 2 need mcap: run pip install -e '.[ros]'"


def test_help_has_an_example():
    assert "Example: fastac log build/paper --frames 100 --mcap touch.mcap" in run("log", "--help").output
