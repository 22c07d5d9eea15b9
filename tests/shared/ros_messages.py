"""Messages of a stream against the record that they were made of, whatever library read or took them."""

import math
import struct

import numpy as np

DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
ENCODINGS = {
    "bgr8": ("u1", 3),
    "mono8": ("u1", 1),
    "32FC1": ("f4", 1),
    "32FC2": ("f4", 2),
    "32FC3": ("f4", 3),
}


def frames_in(path) -> list[int]:
    """Numbers of the frames whose status is in an MCAP file, up to where it was cut."""
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader
    from mcap_ros2.decoder import DecoderFactory

    frames = []
    with path.open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        try:
            for _, channel, _, content in reader.iter_decoded_messages(log_time_order=False):
                if channel.topic.endswith("/status"):
                    frames.append(int(pairs(content.status[0])["frame"]))
        except (EndOfFile, struct.error):  # the latter inside of an index
            pass
    return frames


def image(message) -> np.ndarray:
    """A sensor_msgs/msg/Image as (rows, columns, channels), by its encoding and steps."""
    dtype, channels = ENCODINGS[message.encoding]
    order = ">" if message.is_bigendian else "<"
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    used = np.dtype(dtype).itemsize * channels * message.width
    values = np.ascontiguousarray(rows[:, :used]).view(order + dtype)
    return values.reshape(message.height, message.width, channels)


def cloud(message) -> dict[str, np.ndarray]:
    """The fields of a sensor_msgs/msg/PointCloud2 by name, (rows, columns) each, by their offsets."""
    order = ">" if message.is_bigendian else "<"
    fields = {
        "names": [field.name for field in message.fields],
        "formats": [order + DATATYPES[field.datatype] for field in message.fields],
        "offsets": [field.offset for field in message.fields],
        "itemsize": message.point_step,
    }
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.row_step)
    points = np.ascontiguousarray(rows[:, : message.width * message.point_step]).view(np.dtype(fields))
    return {name: points[name] for name in fields["names"]}


def pairs(status) -> dict[str, str]:
    """The values of a diagnostic_msgs/msg/DiagnosticStatus."""
    return {pair.key: pair.value for pair in status.values}


def level(status) -> int:
    """Its level, which rclpy has as a byte."""
    return status.level[0] if isinstance(status.level, bytes) else int(status.level)


def assert_same(messages: dict, record, about, frame_id: str, *, timing: bool = True) -> None:
    """Every value, stamp and frame of a record's messages, by topic without namespace, are the record's.

    timing : whether that of the same run is expected
    """
    for message in messages.values():
        stamp = message.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == record.source_time_ns
        assert message.header.frame_id == frame_id
    expected = {"status"}
    expected |= {"wrench"} if record.force_n else set()
    expected |= {"points", "depth"} if record.depth_mm is not None else set()
    expected |= {"normals"} if record.normals is not None else set()
    expected |= {"force_map"} if record.force_map_n is not None else set()
    if record.image is not None:
        expected |= {"image_raw", "nir/image_raw"} if "NIR" in about.channels else {"image_raw"}
    assert set(messages) == expected
    _assert_same_force(messages, record)
    _assert_same_skin(messages, record, about)
    if record.image is not None:
        np.testing.assert_array_equal(image(messages["image_raw"]), record.image[..., :3])
        assert messages["image_raw"].encoding == "bgr8"
        if "NIR" in about.channels:
            assert messages["nir/image_raw"].encoding == "mono8"
            np.testing.assert_array_equal(image(messages["nir/image_raw"])[..., 0], record.image[..., 3])
    _assert_same_status(messages["status"], record, about)
    known = {key: value for key, value in vars(record.timing).items() if value is not None}
    found = {key: type(known[key])(text) for key, text in pairs(messages["status"].status[1]).items()}
    assert found == known if timing else found.keys() == known.keys()


def _assert_same_force(messages, record) -> None:
    if record.force_n:
        wrench = messages["wrench"].wrench
        for axis in "xyz":
            assert math.isnan(getattr(wrench.torque, axis))
            force = getattr(wrench.force, axis)
            assert force == record.force_n[axis] if axis in record.force_n else math.isnan(force)
    if record.force_map_n is not None:
        found = image(messages["force_map"])
        np.testing.assert_array_equal(np.moveaxis(found, -1, 0), record.force_map_n)


def _assert_same_skin(messages, record, about) -> None:
    if record.depth_mm is not None:
        z = record.depth_mm.astype(np.float64) / 1000
        depth, points = messages["depth"], cloud(messages["points"])
        assert depth.encoding == "32FC1"
        np.testing.assert_allclose(image(depth)[..., 0], z, rtol=1e-7)
        np.testing.assert_array_equal(points["z"], image(depth)[..., 0])
        rows, columns = np.mgrid[1 : about.height_px - 1, 1 : about.width_px - 1]
        x = (columns - (about.width_px - 1) / 2) * about.pitch_mm / 1000
        y = (rows - (about.height_px - 1) / 2) * about.pitch_mm / 1000
        np.testing.assert_allclose(points["x"], x, rtol=1e-6)
        np.testing.assert_allclose(points["y"], y, rtol=1e-6)
        if record.normals is not None:
            found = np.stack([points[f"normal_{axis}"] for axis in "xyz"], axis=-1)
            np.testing.assert_array_equal(found, record.normals[1:-1, 1:-1])
        assert messages["points"].is_dense
    if record.normals is not None:
        assert messages["normals"].encoding == "32FC3"
        np.testing.assert_array_equal(image(messages["normals"]), record.normals)


def _assert_same_status(message, record, about) -> None:
    frame, _ = message.status
    flagged = record.bad or record.suspect or record.errors
    assert level(frame) == (2 if record.lost else 1 if flagged else 0)
    assert frame.hardware_id == about.bundle_sha256
    found = pairs(frame)
    assert int(found.pop("frame")) == record.frame
    for name in ("lost", "bad", "suspect", "slipping"):
        assert found.pop(name) == str(getattr(record, name)).lower()
    assert tuple(found.pop("reasons").split()) == record.reasons
    assert tuple(found.pop("errors").split()) == record.errors
    for name in ("slip_px", "slip_dots"):
        value = getattr(record, name)
        assert found.pop(name, None) == (None if value is None else str(value))
    assert {key.removeprefix("force_raw."): int(raw) for key, raw in found.items()} == record.force_raw
