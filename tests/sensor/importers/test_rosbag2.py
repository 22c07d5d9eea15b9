from functools import partial

import numpy as np
import pytest

pytest.importorskip("mcap", reason="the extra `ros` is not installed: pip install -e '.[ros]'")
pytest.importorskip("rosbags", reason="the extra `ros` is not installed: pip install -e '.[ros]'")

from miniature_bags import LOADS, START_NS, STEP_NS, image, messages, wrench, write_bag, write_mcap
from miniatures import pressed, refused_by

from fastac.sensor.dataset import read
from fastac.sensor.importers.rosbag2 import import_recordings


def imported(*paths, **changed):
    given = {"pitch_mm": 0.2, "background_frames": 2, "height_px": 24, "width_px": 32, "progress": False}
    import_recordings(paths, output=paths[0].parent / "out.h5", **given | changed)
    return read(paths[0].parent / "out.h5")


refused = partial(refused_by, imported)


def two(place, **given):
    return [write_bag(place / name, messages(**given)) for name in ("pear", "plum")]


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "png"])
def test_frames_have_the_force_nearest_in_time(tmp_path, encoding):
    data = imported(*two(tmp_path, encoding=encoding))
    np.testing.assert_array_equal(data.group, ["pear"] * 9 + ["plum"] * 9)
    np.testing.assert_array_equal(data.split[9:], "test")
    np.testing.assert_array_equal(data.force_n[:, 2], LOADS * 2)
    np.testing.assert_array_equal(data.force_n[4, :2], [0.5, -0.5])
    np.testing.assert_array_equal(data.background[0, 0], [90, 80, 70])  # B, G, R
    np.testing.assert_array_equal(data.frames[:, 8, 10, 1], 80 + 10 * np.array(LOADS * 2))


def test_every_form_of_a_recording(tmp_path):
    given = messages(encoding="jpeg", xy=np.nan)
    paths = [
        write_bag(tmp_path / "a", given),
        write_bag(tmp_path / "b", given, "sqlite3"),
        write_mcap(tmp_path / "c.mcap", given),
        next(write_bag(tmp_path / "other", given, "sqlite3").glob("*.db3")).rename(tmp_path / "d.db3"),
    ]
    data = imported(*paths, held_out=("b",), every=2)
    assert list(dict.fromkeys(data.group.tolist())) == ["a", "b", "c", "d"]
    assert data.force_axes == ("z",)  # x and y are NaN
    for name in "abcd":
        np.testing.assert_array_equal(data.force_n[data.group == name, 0], LOADS[::2])
        np.testing.assert_array_equal(data.frames[data.group == name], data.frames[data.group == "a"])


def test_frames_without_a_wrench_are_counted(tmp_path):
    data = imported(*two(tmp_path, lost=(3, 4)))
    assert data.left_out == 4
    np.testing.assert_array_equal(
        data.force_n[:7, 2], [load for k, load in enumerate(LOADS) if k not in (3, 4)]
    )
    (tmp_path / "out.h5").unlink()
    paths = tmp_path / "pear", tmp_path / "plum"
    assert imported(*paths, tolerance_ms=36.0).left_out == 2  # image 4 gets the wrench before image 5's
    (tmp_path / "out.h5").unlink()
    assert "no image has a wrench within 4 ms, by their stamp times" in refused(*paths, tolerance_ms=4.0)


def test_stamps_or_the_time_of_the_log(tmp_path):
    given = messages()
    pear = write_bag(tmp_path / "pear", [one for one in given if one[0] == "/camera"])
    assert "topic of geometry_msgs/msg/WrenchStamped: expected a recording with one" in refused(pear)
    shifted = [(topic, time_ns + 10**9 * (topic == "/gauge"), message) for topic, time_ns, message in given]
    paths = [write_bag(tmp_path / name, shifted) for name in ("a", "b")]
    assert imported(*paths).left_out == 0
    (tmp_path / "out.h5").unlink()
    assert "by their log times" in refused(*paths, clock="log")


def test_presses_are_groups(tmp_path):
    (path, _) = two(tmp_path)
    assert "group = 'pear' in every row: nothing can be held out" in refused(path)
    data = imported(path, group_by="press")
    np.testing.assert_array_equal(data.group, ["pear/1"] * 7 + ["pear/2"] * 2)
    np.testing.assert_array_equal(data.split[7:], "test")


def test_a_gauge_with_an_offset(tmp_path):
    paths = two(tmp_path, offset_n=1.0)
    assert "1 N in background image 0: expected at most 10% of the largest force" in refused(*paths)
    data = imported(*paths, tare=True)
    np.testing.assert_allclose(data.force_n[:, 2], LOADS * 2)
    (tmp_path / "out.h5").unlink()
    assert "force_z_n = -4 to 0, mostly negative" in refused(*paths, tare=True, negate=True)


def test_topics(tmp_path):
    more = [("/other", START_NS, image(START_NS, pressed(0), "rgb8"))]
    path = write_bag(tmp_path / "a", [*messages(), *more])
    assert "topic of sensor_msgs/msg/Image or" in refused(path)
    assert "expected one of /camera, /other" in refused(path, image_topic="/gauge")
    assert "topic '/camera' of geometry_msgs/msg/WrenchStamped: expected one of /gauge" in refused(
        path, image_topic="/camera", wrench_topic="/camera"
    )
    assert len(imported(path, image_topic="/camera", group_by="press")) == 9


def test_errors(tmp_path):
    def bag(name: str, *more):
        return write_bag(tmp_path / name, [*messages(), *more])

    last = START_NS + 9 * STEP_NS
    small = bag(
        "small",
        ("/camera", last, image(last, pressed(1, 40), "rgb8")),
        ("/gauge", last, wrench(last, (0, 0, 1))),
    )
    assert "small: /camera: image 9 = 64 x 40 px: expected the background's 64 x 48 px" in refused(
        small, group_by="press"
    )
    grey = image(last, pressed(1), "rgb8")
    grey.encoding = "mono8"
    assert "encoding = 'mono8': expected one of bgr8" in refused(
        bag("grey", ("/camera", last, grey), ("/gauge", last, wrench(last, (0, 0, 1)))), group_by="press"
    )
    short = image(last, pressed(1), "rgb8")
    short.height = 49
    assert "64 x 49 px of 194 bytes a row: 9312 bytes are there" in refused(
        bag("short", ("/camera", last, short), ("/gauge", last, wrench(last, (0, 0, 1)))), group_by="press"
    )
    nan = bag("nan", ("/gauge", START_NS + 4_000_000, wrench(0, (0, 0, np.nan))))
    assert "wrench.force.z = NaN" in refused(nan, clock="log")
    assert "9 images: expected 12 of background" in refused(small.with_name("nan"), background_frames=12)
    assert "none: no such file or folder" in refused(tmp_path / "none")
    assert "tolerance_ms = -1: expected 0 or more" in refused(nan, tolerance_ms=-1.0)
    assert "another recording has the name 'small' too" in refused(small, small)
    cut = tmp_path / "cut.mcap"
    whole = write_mcap(tmp_path / "whole.mcap", messages()).read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    assert "cut.mcap: not a readable ROS 2 recording" in refused(cut)
    (small / "small.mcap").rename(tmp_path / "small.mcap")
    (small / "small.mcap").symlink_to(tmp_path / "small.mcap")
    assert "'small.mcap': not a file inside this folder" in refused(small)
    (tmp_path / "a.txt").write_text("x")
    assert "a.txt: not a readable ROS 2 recording: Unrecognized storage format" in refused(tmp_path / "a.txt")


def test_without_rosbags(tmp_path, monkeypatch):
    monkeypatch.setattr("fastac.sensor.importers.ros_recording.find_spec", lambda name: None)
    assert "ROS 2 recordings need rosbags: run pip install" in refused(tmp_path / "none")
