import numpy as np
import pytest

from fastac.scenes.schema import parse
from fastac.sensor.dataset import DatasetError, write
from fastac.sensor.recorded_scene import of_recording

TEXT = """
name = "gel"
outputs = ["normals"]
[sensor]
geometry = "flat"
height_px = 32
width_px = 32
pitch_mm = 0.1
channels = "bgr"
source = "recorded"
frames = "channels"
"""


def scene(old: str = "", new: str = ""):
    return parse(TEXT.replace(old, new), origin="gel")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "d.h5"


def recorded(path, height: int, width: int, pitch_mm: float, *, raw10: bool = False):
    channels = ("B", "G", "R")
    if raw10:
        image = np.full((4 * height, 4 * width), 100, np.uint16)
        arrays = {"background": image, "raw10": image[None]}
    else:
        image = np.zeros((height, width, 3), np.uint8)
        arrays = {"background": image, "frames": image[None]}
    split = np.array(["train"])
    write(path, pitch_mm=pitch_mm, channels=channels, source="recorded: a test", split=split, **arrays)
    return path


@pytest.mark.parametrize("raw10", [False, True])
def test_size_and_pitch_are_the_recordings(path, raw10):
    known = scene('"channels"', '"raw10"') if raw10 else scene()
    found, changed = of_recording(known, recorded(path, 24, 32, 1 / 7, raw10=raw10))
    assert (found.sensor.height_px, found.sensor.width_px, found.sensor.pitch_mm) == (24, 32, 0.142857)
    assert changed == {"height_px": (32, 24), "pitch_mm": (0.1, 0.142857)}
    back = found.sensor.model_copy(update={"height_px": 32, "pitch_mm": 0.1})
    assert found.model_copy(update={"sensor": back}) == known


def test_a_pitch_that_was_rounded_stays(path):
    known = scene()
    found, changed = of_recording(known, recorded(path, 32, 32, 0.10005))
    assert found is known
    assert not changed


def test_a_simulated_scene_stays(path):
    known = scene('"recorded"', '"simulated"')
    assert of_recording(known, path) == (known, {})  # nothing is read: the file is not there


def test_what_no_scene_can_be(path):
    with pytest.raises(DatasetError, match=r"d\.h5: no such file"):
        of_recording(scene(), path)
    recorded(path, 300, 32, 0.1)
    with pytest.raises(DatasetError, match=r"d\.h5: sensor\.height_px = 300: .* less than or equal to 256"):
        of_recording(scene(), path)
