"""`fastac serve` in FasTac's environment, LeRobot in its own: what is read and recorded is what was found.

Runs where the variable FASTAC names the command `fastac`, as in `make lerobot` of FasTac's repository; its
Python must lie beside it.
"""

import os
import socket
import subprocess
import sys
from pathlib import Path

import draccus
import numpy as np
import pytest
from lerobot.cameras import CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.utils.import_utils import register_third_party_plugins

HERE = Path(__file__).parent
FASTAC = os.environ.get("FASTAC")
pytestmark = pytest.mark.skipif(not FASTAC, reason="FASTAC names no command `fastac`")
SIZE, GRID = 64, (4, 8)
DATASET_FPS = 20


@pytest.fixture(scope="module")
def build(tmp_path_factory) -> Path:
    """A small simulated sensor, trained by FasTac."""
    folder = tmp_path_factory.mktemp("build") / "small"
    subprocess.run([FASTAC, "train", HERE / "small.toml", "-o", folder, "--no-progress"], check=True)
    return folder


@pytest.fixture(scope="module")
def expected(build, tmp_path_factory) -> dict[str, np.ndarray]:
    """What FasTac finds in each frame."""
    target = tmp_path_factory.mktemp("records") / "expected.npz"
    subprocess.run(
        [Path(FASTAC).with_name("python"), HERE / "expected_records.py", build, target], check=True
    )
    with np.load(target) as found:
        return dict(found)


@pytest.fixture
def serve(build):
    """`serve("--loop")`: the address at which `fastac serve` offers the build's stream."""
    started = []

    def serve(*options: str) -> str:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        command = [FASTAC, "serve", build, "--bind", address, "--no-progress", *options]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert "small by emulator" in started[-1].stdout.readline()
        return address

    yield serve
    for one in started:
        one.terminate()
        one.communicate(timeout=30)


def camera_of(address: str, **content):
    """As LeRobot makes it from a configuration."""
    register_third_party_plugins()
    config = {"type": "fastac", "address": address, "grid": list(GRID), "timeout_s": 60, **content}
    return make_cameras_from_configs({"tip": draccus.decode(CameraConfig, config)})["tip"]


def read_all(camera, read: list) -> None:
    while True:
        image = camera.async_read(timeout_ms=60_000)
        read.append((camera.record, image, camera.tactile()))


def test_every_record_is_read_as_it_was_found(serve, expected):
    camera = camera_of(serve("--wait", "1", "--fps", "20"), tare_frames=1)
    read = []
    with camera:
        rest_mm, first = camera.rest_mm, camera.record.frame
        with pytest.raises(ConnectionError, match="the stream has ended"):
            read_all(camera, read)
    np.testing.assert_array_equal(rest_mm, expected["depth_mm"][first])
    frames = [record.frame for record, _, _ in read]
    assert frames == list(range(first + 1, len(expected["force_n"])))
    assert len(frames) > 20
    for record, image, touch in read:
        k = record.frame
        assert record.source_time_ns == k * 50_000_000
        assert list(record.force_n.values()) == expected["force_n"][k].tolist()
        for name in ("depth_mm", "force_map_n", "image"):
            np.testing.assert_array_equal(record.arrays[name], expected[name][k])
        np.testing.assert_array_equal(image, expected["image"][k][..., [2, 1, 0]])
        np.testing.assert_array_equal(touch["wrench"][:3], expected["force_n"][k].astype(np.float32))
        assert touch["points"].shape == (32, 6)
        summed = expected["force_map_n"][k].sum((1, 2), dtype=float)
        np.testing.assert_allclose(touch["points"][:, 3:].sum(0), summed, rtol=1e-4, atol=1e-5)
        corner = rest_mm[:16, :8] - expected["depth_mm"][k][:16, :8]
        np.testing.assert_allclose(touch["points"][0, 2], corner.mean(), rtol=1e-4, atol=1e-6)


def test_lerobot_record_keeps_what_was_found(serve, expected, tmp_path):
    tip = f"type: fastac, address: '{serve('--loop', '--fps', '50')}', width: {SIZE}, height: {SIZE}, fps: 50"
    options = {
        "robot.type": "fastac_touch",
        "robot.arm": "{type: stand_in_arm}",
        "robot.fingertips": f"{{tip: {{{tip}, tare_frames: 0}}}}",
        "robot.force_axes": "[x, y, z]",
        "teleop.type": "stand_in_leader",
        "dataset.repo_id": "fastac/served",
        "dataset.root": tmp_path / "recorded",
        "dataset.single_task": "press",
        "dataset.fps": DATASET_FPS,
        "dataset.num_episodes": 1,
        "dataset.episode_time_s": 2,
        "dataset.push_to_hub": "false",
        "play_sounds": "false",
    }
    program = "import stand_in_arm; from lerobot.scripts.lerobot_record import main; main()"
    command = [sys.executable, "-c", program, *(f"--{key}={value}" for key, value in options.items())]
    environment = {"HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "1", "PYTHONPATH": str(HERE)}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=300)
    dataset = LeRobotDataset("fastac/served", root=tmp_path / "recorded", video_backend="pyav")
    assert len(dataset) > DATASET_FPS
    known = expected["force_n"].astype(np.float32)
    kept = np.stack([dataset[k]["observation.state"].numpy()[1:4] for k in range(len(dataset))])
    which = [np.flatnonzero((known == force_n).all(1)) for force_n in kept]
    assert all(len(one) == 1 for one in which)
    assert len({int(one[0]) for one in which}) > 10
    for k in (0, len(dataset) - 1):
        shown = 255 * dataset[k]["observation.images.tip"].numpy().transpose(1, 2, 0)
        sent = expected["image"][which[k][0]][..., [2, 1, 0]].astype(float)
        assert np.abs(shown - sent).mean() < 6
