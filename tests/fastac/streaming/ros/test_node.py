"""The node against a stand-in for ROS 2: messages, topics, quality of service, parameters."""

import subprocess
import sys

import pytest

pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")

import rclpy_stand_in as stand_in
from offered import offered
from ros_messages import assert_same, pairs

from fastac.streaming.ros import node as nodes
from fastac.streaming.ros.messages import build


def until_line(text: str):
    """Ends the node's run once it has logged a line with this text."""

    def on_turn(ros) -> None:
        if any(text in line for line in ros.node.get_logger().lines):
            ros.shutdown()

    return on_turn


def run(monkeypatch, about, records, **parameters):
    """A node that has published the records: the stand-in."""
    with offered(about, records) as address:
        parameters = {"address": address, **parameters}
        ros = stand_in.install(monkeypatch, parameters, until_line("end of the stream"))
        nodes.main([])
    assert ros.node.destroyed
    return ros


def test_each_record_is_published_with_all_its_values(monkeypatch, about, records):
    ros = run(monkeypatch, about, records, frame_id="left_tip")
    for record in records:
        found = {}
        for publisher in ros.node.publishers:
            for message in publisher.sent:
                stamp = message.header.stamp
                if stamp.sec * 1_000_000_000 + stamp.nanosec == record.source_time_ns:
                    found[publisher.topic.removeprefix("/fastac/")] = message
        assert_same(found, record, about, "left_tip")
    assert ros.node.get_logger().lines[-1] == "end of the stream: 3 records, 0 missed"


def test_publishers_are_reliable_and_volatile(monkeypatch, about, records):
    ros = run(monkeypatch, about, records[:1])
    assert {publisher.qos for publisher in ros.node.publishers} == {
        stand_in.QoSProfile(
            history=stand_in.HistoryPolicy.KEEP_LAST,
            depth=10,
            reliability=stand_in.ReliabilityPolicy.RELIABLE,
            durability=stand_in.DurabilityPolicy.VOLATILE,
        )
    }


def test_only_the_topics_asked_for_are_published(monkeypatch, about, records):
    ros = run(monkeypatch, about, records, topics="wrench, status", unmeasured="zero")
    assert [one.topic for one in ros.node.publishers] == ["/fastac/wrench", "/fastac/status"]
    assert [len(one.sent) for one in ros.node.publishers] == [2, 3]
    assert ros.node.publishers[0].sent[0].wrench.torque.x == 0.0


def test_stamps_may_be_those_of_arrival(monkeypatch, about, records):
    with offered(about, records[:1]) as address:
        end = until_line("end of the stream")

        def on_turn(ros) -> None:
            ros.node.now_ns = 7_000_000_008
            end(ros)

        ros = stand_in.install(monkeypatch, {"address": address, "stamp": "now"}, on_turn)
        nodes.main([])
    for publisher in ros.node.publishers:
        stamp = publisher.sent[0].header.stamp
        assert (stamp.sec, stamp.nanosec) == (7, 8)


def test_only_the_newest_records_may_be_published(monkeypatch, about, records):
    ros = run(monkeypatch, about, records, latest=True)
    status = next(one for one in ros.node.publishers if one.topic == "/fastac/status")
    assert pairs(status.sent[-1].status[0])["frame"] == "2"


def test_the_node_waits_for_a_stream_and_for_the_next_one(monkeypatch, about, records):
    monkeypatch.setattr(nodes, "WAIT_S", 0.2)
    with offered(about, records[:1]) as first, offered(about, records[1:2]) as second:
        addresses = iter(["tcp://127.0.0.1:9", "tcp://127.0.0.1:9", first, second])
        connect = nodes.connect
        monkeypatch.setattr(nodes, "connect", lambda _, **options: connect(next(addresses), **options))

        def on_turn(ros) -> None:
            if sum("end of the stream" in line for line in ros.node.get_logger().lines) == 2:
                ros.shutdown()

        ros = stand_in.install(monkeypatch, {}, on_turn)
        nodes.main([])
    waits = [line for line in ros.node.get_logger().lines if "waiting" in line]
    assert len(waits) == 1
    assert sum(len(one.sent) for one in ros.node.publishers if one.topic == "/fastac/status") == 2
    assert all(publisher.destroyed for publisher in ros.node.publishers)


@pytest.mark.parametrize(
    ("parameters", "line"),
    [
        ({"topics": "wrench,depths"}, "parameter topics: 'depths': expected some of wrench, points"),
        ({"unmeasured": "0"}, "parameter unmeasured: '0': expected nan or zero"),
        ({"stamp": "host"}, "parameter stamp: 'host': expected source or now"),
        ({"address": "localhost"}, "localhost: expected an address such as"),
    ],
)
def test_wrong_parameters_are_one_line(monkeypatch, parameters, line):
    ros = stand_in.install(monkeypatch, parameters)
    with pytest.raises(SystemExit) as stopped:
        nodes.main([])
    assert str(stopped.value.code).startswith(f"Error: {line}")
    assert ros.node.destroyed
    assert not ros.ok()


def test_without_ros_it_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(SystemExit) as stopped:
        nodes.main([])
    assert "rclpy is not there" in str(stopped.value.code)


def test_the_node_needs_numpy_and_pyzmq_and_nothing_else():
    """In a fresh interpreter nothing else can be imported that is neither ours nor Python's."""
    code = """
import sys

class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in {"fastac", "numpy", "zmq", *sys.stdlib_module_names}:
            raise ImportError(name)

sys.meta_path.insert(0, Nothing())
import fastac.streaming.ros.node
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("kind", "content", "reason"),
    [
        ("sensor_msgs/msg/Image", {"hight": 1}, "has no"),
        ("sensor_msgs/msg/Image", {"data": b"1"}, "octet by octet"),
        ("sensor_msgs/msg/Image", {"height": -1}, "is no uint32"),
        ("sensor_msgs/msg/Image", {"header": {"frame": "a"}}, "has no"),
        ("diagnostic_msgs/msg/DiagnosticStatus", {"level": 1}, "is no byte"),
        ("geometry_msgs/msg/Vector3", {"x": 1}, "is no float64"),
    ],
)
def test_the_stand_in_refuses_what_ros_refuses(monkeypatch, kind, content, reason):
    stand_in.install(monkeypatch)
    with pytest.raises(AssertionError, match=reason):
        build(nodes.classes(), kind, content)
