"""Contents of messages: fields of the standard types, units, axes, and what stands for the unknown."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from ros_messages import assert_same, cloud, image

from fastac.streaming.record import StreamRecord
from fastac.streaming.ros.messages import Messages, build
from fastac.streaming.ros.topics import ALL, NESTED

CLASSES = dict.fromkeys([*NESTED.values(), *(topic.type for topic in ALL)], SimpleNamespace)


def made(messages: Messages, record: StreamRecord) -> dict:
    return {
        message.topic.name: build(CLASSES, message.topic.type, message.content)
        for message in messages.of(record)
    }


def test_messages_have_all_that_the_record_has(about, records):
    messages = Messages(about, frame_id="left")
    for record in records:
        assert_same(made(messages, record), record, about, "left")


def test_topics_are_those_of_a_good_frame(about, records):
    messages = Messages(about)
    assert [topic.name for topic in messages.topics] == list(made(messages, records[0]))


def test_of_a_lost_frame_nothing_is_made_up(about, records):
    found = made(Messages(about), records[2])
    assert not {"wrench", "points", "depth", "normals", "force_map"} & set(found)
    assert found["status"].status[0].message == "lost"


def test_what_is_not_measured_is_what_was_asked_for(about, records):
    found = made(Messages(about, unmeasured=0.0), records[0])["wrench"].wrench
    assert vars(found.torque) == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert vars(found.force) == dict.fromkeys("xyz", 0.0) | records[0].force_n


def test_points_are_in_metres_about_the_middle_of_the_image(about, records):
    points = cloud(made(Messages(about), records[0])["points"])
    assert points["x"][0, 0] == np.float32(-2.5 * 0.25e-3)
    assert points["y"][0, 0] == np.float32(-1.5 * 0.25e-3)
    assert points["x"][0, -1] == -points["x"][0, 0]
    assert (np.diff(points["x"], axis=1) > 0).all()
    assert (np.diff(points["y"], axis=0) > 0).all()


def test_values_are_little_endian_whatever_the_record_has(about, records):
    record = records[0]
    other = {name: array.astype(array.dtype.newbyteorder(">")) for name, array in record.arrays.items()}
    expected, found = (made(Messages(about), r) for r in (record, replace(record, arrays=other)))
    np.testing.assert_array_equal(image(found["depth"]), image(expected["depth"]))
    np.testing.assert_array_equal(found["points"].data, expected["points"].data)


def test_timing_says_whose_clock_it_is(about, records):
    texts = [
        made(Messages(replace(about, simulated_clock=simulated)), records[0])["status"].status[1].message
        for simulated in (True, False)
    ]
    assert texts == [
        "times in hardware are of a simulated clock",
        "times in hardware are of the hardware's clock",
    ]


def test_remarks_say_what_is_wrong(about, records):
    found = [made(Messages(about), record)["status"].status[0] for record in records]
    assert [status.message for status in found] == [
        "ok",
        "bad, slipping, suspect: change level, errors: input_cut",
        "lost",
    ]


def test_images_of_other_channels_are_refused(about):
    with pytest.raises(ValueError, match="channels R, G, B: images of B, G, R and NIR are known"):
        Messages(replace(about, channels=("R", "G", "B"), arrays=("image",)))
