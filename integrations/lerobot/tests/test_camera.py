"""Images, points and wrench of a stream, as LeRobot's robots read cameras."""

import numpy as np
import pytest
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from lerobot_camera_fastac import FastacCamera, FastacCameraConfig
from stand_in import SIZE


@pytest.mark.parametrize(
    ("changes", "pixel"),
    [({}, [30, 20, 10]), ({"color_mode": "bgr"}, [10, 20, 30]), ({"content": "nir"}, [40, 40, 40])],
)
def test_an_image_has_the_configured_channels(connect, changes, pixel):
    camera, _ = connect(**changes)
    for image in (camera.read(), camera.async_read(), camera.read_latest()):
        assert (image.shape, image.dtype) == ((SIZE, SIZE, 3), np.uint8)
        assert (image == pixel).all()
    assert (camera.width, camera.height) == (SIZE, SIZE)


def test_a_depth_image_shows_the_indentation_in_its_range(connect, press):
    camera, stream = connect(content="depth", depth_range_mm=(0.0, 0.5))
    assert (camera.read() == 0).all()
    image = press(camera, stream, 0.25)
    assert image.shape == (SIZE - 2, SIZE - 2, 3)
    assert (image == 128).all()
    assert (press(camera, stream, 2.0) == 255).all()


def test_touch_is_of_the_record_that_was_read(connect, press):
    camera, stream = connect(grid=(31, 2))
    press(camera, stream, 0.5)
    touch = camera.tactile()
    stream.pressed_mm = 0.75
    assert (touch["points"].shape, touch["points"].dtype) == ((62, 6), np.float32)
    expected = np.float32([np.nan, np.nan, 0.5, 62 * 0.0005, 62 * 0.0005, 62 * 0.0005])
    np.testing.assert_allclose(touch["points"], np.tile(expected, (62, 1)), rtol=1e-5)
    np.testing.assert_array_equal(touch["wrench"], np.float32([0.125, -0.25, 0.5, np.nan, np.nan, np.nan]))
    camera.read()
    np.testing.assert_array_equal(camera.tactile()["wrench"][2], camera.record.force_n["z"])


def test_what_is_not_known_is_zero_where_that_is_asked_for(connect, press):
    camera, stream = connect(unknown="zero", tare_frames=0)
    press(camera, stream, 0.5)
    touch = camera.tactile()
    assert (touch["points"][:, :3] == 0).all()
    assert (touch["wrench"][3:] == 0).all()


def test_tare_makes_the_present_skin_the_one_at_rest(connect, press):
    camera, stream = connect(tare_frames=0)
    press(camera, stream, 0.5)
    assert np.isnan(camera.tactile()["points"][:, 2]).all()
    camera.tare(3)
    camera.read()
    np.testing.assert_allclose(camera.tactile()["points"][:, 2], 0, atol=1e-6)


def test_a_depth_image_wants_a_rest(connect):
    camera, _ = connect(content="depth", tare_frames=0)
    with pytest.raises(RuntimeError, match=r"no depth at rest: call tare\(\)"):
        camera.read()


def test_async_read_gives_each_record_once(connect):
    camera, _ = connect()
    frames = []
    for _ in range(20):
        camera.async_read(timeout_ms=5000)
        frames.append(camera.record.frame)
    assert frames == sorted(set(frames))


def read_on(camera, timeout_ms: float) -> None:
    while True:
        camera.async_read(timeout_ms)


def test_a_stream_that_ends_is_told_from_one_that_is_slow(connect):
    camera, stream = connect()
    with pytest.raises(TimeoutError, match="no new record within 0 s"):
        read_on(camera, timeout_ms=0)
    stream.close()
    with pytest.raises(ConnectionError, match="the stream has ended"):
        read_on(camera, timeout_ms=5000)
    with pytest.raises(TimeoutError, match="ms ago: allowed are -1 ms"):
        camera.read_latest(max_age_ms=-1)


@pytest.mark.parametrize(
    ("about", "changes", "message"),
    [
        ({}, {"width": 128}, "width = 128: the stream's images have 64"),
        ({}, {"content": "depth", "height": 64}, "height = 64: the stream's images have 62"),
        ({}, {"grid": (63, 4)}, r"grid = \[63, 4\]: the sensor has 62 × 62 px without its rim"),
        (
            {"arrays": ["image"]},
            {"content": "depth"},
            "content = 'depth': needs depth_mm; records have image",
        ),
        ({"arrays": []}, {}, "content = 'image': needs image; records have no arrays"),
        (
            {"channels": ["B", "G", "R"]},
            {"content": "nir"},
            "content = 'nir': the sensor's channels are B, G, R",
        ),
    ],
)
def test_a_stream_of_another_sensor_is_refused(connect, about, changes, message):
    with pytest.raises(ConnectionError, match=message):
        connect(about, **changes)


def test_without_a_stream_connecting_ends():
    camera = FastacCamera(FastacCameraConfig(address="tcp://127.0.0.1:1", timeout_s=0.05))
    with pytest.raises(ConnectionError, match=r"no stream within 0\.05 s: is `fastac serve` running there"):
        camera.connect()
    assert not camera.is_connected


def test_lerobots_errors_say_whether_it_is_connected(connect):
    camera, _ = connect()
    with pytest.raises(DeviceAlreadyConnectedError):
        camera.connect()
    camera.disconnect()
    for call in (camera.read, camera.async_read, camera.read_latest, camera.tactile, camera.disconnect):
        with pytest.raises(DeviceNotConnectedError):
            call()
