"""LeRobot's own recorder and datasets keep touch, and give it back."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot_camera_fastac.dataset import tactile_features, tactile_frame
from stand_in import SIZE

RECORD = "import stand_in_arm; from lerobot.scripts.lerobot_record import main; main()"


def test_lerobot_record_keeps_image_force_and_points(serve, tmp_path):
    stream = serve()
    stream.later_mm = 0.5
    tip = f"type: fastac, address: '{stream.address}', width: {SIZE}, height: {SIZE}, fps: 20, grid: [2, 3]"
    options = {
        "robot.type": "fastac_touch",
        "robot.arm": "{type: stand_in_arm}",
        "robot.fingertips": f"{{tip: {{{tip}}}}}",
        "robot.force_axes": "[x, y, z]",
        "robot.point_columns": "[dz]",
        "teleop.type": "stand_in_leader",
        "dataset.repo_id": "fastac/stand_in",
        "dataset.root": tmp_path / "recorded",
        "dataset.single_task": "press",
        "dataset.fps": 20,
        "dataset.num_episodes": 1,
        "dataset.episode_time_s": 1,
        "dataset.reset_time_s": 0,
        "dataset.push_to_hub": "false",
        "play_sounds": "false",
    }
    command = [sys.executable, "-c", RECORD, *(f"--{key}={value}" for key, value in options.items())]
    environment = {"HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "1", "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    dataset = LeRobotDataset("fastac/stand_in", root=tmp_path / "recorded", video_backend="pyav")
    points = [f"tip.{k}.dz" for k in range(6)]
    assert dataset.features["observation.state"]["names"] == [
        "joint.pos",
        "tip.Fx",
        "tip.Fy",
        "tip.Fz",
        "tip.suspect",
        *points,
    ]
    assert dataset.features["observation.images.tip"]["shape"] == (SIZE, SIZE, 3)
    assert len(dataset) > 5
    last = dataset[len(dataset) - 1]
    np.testing.assert_allclose(last["observation.state"], [12.5, 0.125, -0.25, 0.5, 0, *[0.5] * 6], rtol=1e-6)
    colours = 255 * last["observation.images.tip"].mean((1, 2)).numpy()
    np.testing.assert_allclose(colours, [30, 20, 10], atol=4)


@pytest.mark.parametrize("unknown", ["nan", "zero"])
def test_a_dataset_keeps_points_and_wrench_as_arrays(connect, press, tmp_path, unknown):
    camera, stream = connect(grid=(2, 3), unknown=unknown)
    features = {"action": {"dtype": "float32", "shape": (1,), "names": ["joint.pos"]}}
    dataset = LeRobotDataset.create(
        "fastac/arrays",
        fps=20,
        root=tmp_path / "arrays",
        features={**features, **tactile_features("tip", camera.taxels.count)},
        use_videos=False,
    )
    sent = []
    for pressed_mm in (0.25, 0.5, 0.75):
        press(camera, stream, pressed_mm)
        sent.append(camera.tactile())
        action = np.float32([pressed_mm])
        dataset.add_frame({"action": action, "task": "press", **tactile_frame("tip", sent[-1])})
    dataset.save_episode()
    dataset.finalize()
    kept = LeRobotDataset("fastac/arrays", root=tmp_path / "arrays")
    assert len(kept) == 3
    for k, touch in enumerate(sent):
        for part in ("points", "wrench"):
            np.testing.assert_array_equal(kept[k][f"observation.tactile.tip.{part}"], touch[part])
        assert touch["points"][:, 2] == pytest.approx(kept[k]["action"].item(), rel=1e-5)
