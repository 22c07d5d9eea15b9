"""RAW10 frames become channels in one place, once."""

import json

import numpy as np
import pytest

from fastac.flow import frames
from fastac.flow.build import Build
from fastac.models.vision import image_processing
from fastac.sensor import dataset
from fastac.sensor.fingertip import generate, sample
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import Station

RAW = {"frames": "raw10"}


@pytest.fixture(scope="module")
def raw_scene(make_scene):
    protocol = {"train_grid": 1, "validation_grid": 1, "test_grid": 1, "loads_n": [0.05]}
    return make_scene(sensor=RAW, protocol=protocol)


@pytest.fixture(scope="module")
def raw_file(raw_scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("raw") / "raw.h5"
    generate(raw_scene, path, progress=False, processes=1)
    return path


def test_channels_are_left_as_they_are(tiny_file, tiny_scene, tmp_path):
    data = frames.read(tiny_file, tiny_scene, store=tmp_path / "cache")
    np.testing.assert_array_equal(data.frames, dataset.read(tiny_file).frames)
    assert not (tmp_path / "cache").exists(), "nothing is processed, so nothing is kept"


@pytest.mark.parametrize("changes", [{}, RAW])
def test_of_a_press_is_what_the_models_take(changes, make_scene):
    sensor = make_scene(sensor=changes).sensor
    pressed = rig_of(sensor, "unused").presses(Station("test", 0.0, 0.0, 0.05, 1.5))[0]
    image = frames.of_press(pressed, sensor, np.random.default_rng(1))
    assert (image.shape, image.dtype) == ((16, 16, 4), np.uint8)
    seen = sample(pressed, sensor, np.random.default_rng(1))["frame"]
    np.testing.assert_array_equal(image, image_processing.channels(seen, sensor) if changes else seen)


def test_raw10_is_processed_once(raw_file, raw_scene, tmp_path, monkeypatch):
    data = frames.read(raw_file, raw_scene, store=tmp_path)
    raw = dataset.read(raw_file, raw_scene)
    assert raw.frames is None
    assert raw.raw10.shape == (3, 64, 64)
    assert data.raw10 is None
    assert data.frames.shape == (3, 16, 16, 4)
    np.testing.assert_array_equal(data.frames[1], image_processing.channels(raw.raw10[1], raw_scene.sensor))
    np.testing.assert_array_equal(
        data.background, image_processing.channels(raw.background, raw_scene.sensor)
    )
    (kept,) = tmp_path.rglob(frames.PROCESSED)
    with monkeypatch.context() as patch:
        patch.setattr(frames, "channels", None)
        np.testing.assert_array_equal(frames.read(raw_file, raw_scene, store=tmp_path).frames, data.frames)
    kept.chmod(0o644)
    kept.write_bytes(b"half")
    np.testing.assert_array_equal(frames.read(raw_file, raw_scene, store=tmp_path).frames, data.frames)


def test_settings_decide_what_is_kept(raw_file, raw_scene, make_scene, tmp_path):
    binned = make_scene(sensor={**RAW, "raw10": {"method": "binning"}})
    three = make_scene(sensor={**RAW, "channels": "bgr"})
    one, two = (frames.read(raw_file, s, store=tmp_path).frames for s in (raw_scene, binned))
    assert (one != two).any()
    assert np.abs(one.astype(int) - two).mean() < 6
    assert len(list(tmp_path.rglob(frames.PROCESSED))) == 2
    raw = dataset.read(raw_file)
    np.testing.assert_array_equal(image_processing.channels(raw.raw10[0], three.sensor), one[0, ..., :3])


def test_frames_must_be_of_the_scene_s_kind(raw_file, tiny_file, tiny_scene, raw_scene, tmp_path):
    with pytest.raises(dataset.DatasetError, match=r"frames = raw10: expected channels \(tiny\)"):
        frames.read(raw_file, tiny_scene, store=tmp_path)
    with pytest.raises(dataset.DatasetError, match=r"frames = channels: expected raw10 \(tiny\)"):
        frames.read(tiny_file, raw_scene, store=tmp_path)


def test_channels_that_are_kept_are_not_given_to_a_scene_that_does_not_fit(
    raw_file, raw_scene, make_scene, tmp_path
):
    frames.read(raw_file, raw_scene, store=tmp_path)
    coarser = make_scene(sensor=RAW | {"pitch_mm": 1.5 * raw_scene.sensor.pitch_mm})
    with pytest.raises(dataset.DatasetError, match=r"raw.h5: pitch_mm = .*: expected"):
        frames.read(raw_file, coarser, store=tmp_path)


def test_a_press_is_as_clear_in_raw10_as_in_channels(raw_file, raw_scene, tmp_path):
    """The processed frames differ from the background where the skin moved."""
    data = frames.read(raw_file, raw_scene, store=tmp_path)
    moved = data.rest_depth_mm - data.depth_mm > 0.02
    change = np.abs(data.frames.astype(int) - data.background).mean(axis=-1)
    assert change[moved].mean() > 2 * change[:, [0, -1]].mean()


def test_training_and_evaluation_take_them(make_scene, tmp_path):
    protocol = {"train_grid": 2, "validation_grid": 1, "test_grid": 1}
    quick = {"normals_epochs": 2, "finetune_epochs": 1, "force_epochs": 1}
    scene = make_scene(sensor=RAW, protocol=protocol, training=quick)
    build = Build(scene, tmp_path / "raw", progress=False)
    build.run(lambda name, current: None, until="evaluate")
    assert len(list((tmp_path / "store").rglob(frames.PROCESSED))) == 1
    errors = json.loads((tmp_path / "raw" / "accuracy.json").read_text())
    assert 0 < errors["integer"]["normal_mae_deg"] < 30
    assert build.bundle.pipeline.background.shape == (16, 16, 4)
