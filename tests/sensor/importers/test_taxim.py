from functools import partial

import numpy as np
import pytest
from miniatures import refused_by, taxim_pack

from fastac.sensor.dataset import read
from fastac.sensor.importers.taxim import import_pack

NAMES = [f"frame_{k + 1}.jpg" for k in range(5)]


@pytest.fixture
def folder(tmp_path):
    return taxim_pack(tmp_path / "calibs")


def imported(folder, **changed):
    given = {"ball_mm": 4.0, "px_per_mm": 10.0, "height_px": 32, "width_px": 32, "progress": False}
    import_pack(folder / "dataPack.npz", output=folder.parent / "out.h5", **given | changed)
    return read(folder.parent / "out.h5")


refused = partial(refused_by, imported)


def change(folder, **changed):
    """Other arrays of the pack; None takes one away."""
    with np.load(folder / "dataPack.npz") as pack:
        arrays = dict(pack) | changed
    np.savez(folder / "dataPack.npz", **{key: value for key, value in arrays.items() if value is not None})


def test_presses_are_those_of_the_pack(folder):
    data = imported(folder)
    np.testing.assert_array_equal(data.group, [*NAMES, "background"])
    np.testing.assert_array_equal(data.split, ["train"] * 4 + ["test", "train"])
    np.testing.assert_array_equal(data.frames[:5, 16, 16, 0], 50 + np.arange(5))
    np.testing.assert_array_equal(data.frames[5, 16, 16], [70, 80, 90])
    np.testing.assert_allclose(np.diff(data.indenter["center_px"][:5, 0]), 0.5)
    np.testing.assert_array_equal(data.indenter["radius_px"][:5], 6)


def test_presses_may_be_named_that_are_held_out(folder):
    split = imported(folder, held_out=("frame_1.jpg", "frame_3.jpg")).split
    np.testing.assert_array_equal(split, ["test", "train", "test", "train", "train", "train"])
    (folder.parent / "out.h5").unlink()
    assert "group 'x': expected one of frame_1.jpg" in refused(folder, held_out=("x",))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"f0": None}, "f0: missing array"),
        ({"imgs": None}, r"imgs: expected photographs, (presses, height, width, 3) uint8"),
        ({"imgs": np.zeros((5, 48, 64, 3))}, "imgs = float64 of shape (5, 48, 64, 3): expected uint8"),
        ({"f0": np.zeros((48, 60, 3), np.uint8)}, "expected uint8 of shape (48, 64, 3)"),
        ({"touch_radius": [12] * 4}, "touch_radius = int64 of shape (4,): expected numbers of shape (5,)"),
        ({"touch_center": np.full((5, 2), np.nan)}, "touch_center: not all are finite"),
        ({"names": np.arange(5)}, "names = int64 of shape (5,): expected text"),
        ({"names": ["a.jpg"] * 5}, "names: 'a.jpg' is there 5 times"),
        ({"touch_radius": [12] * 4 + [25]}, "dataPack.npz: frame_5.jpg: radius_px = 25: 2.500 mm"),
        ({"touch_center": [(30, 60)] * 5}, "frame_1.jpg: center_y_px = 60: not in the image of"),
    ],
)
def test_what_is_wrong_with_a_pack_is_said(folder, changed, message):
    change(folder, **changed)
    assert message in refused(folder)


def test_objects_are_not_unpickled(folder):
    change(folder, names=np.array(NAMES, dtype=object))
    assert "dataPack.npz: damaged or no .npz file" in refused(folder)


def test_a_file_that_is_no_pack(folder):
    (folder / "dataPack.npz").write_bytes(b"PK")
    assert "dataPack.npz: damaged or no .npz file" in refused(folder)
    (folder / "dataPack.npz").unlink()
    assert "dataPack.npz: No such file" in refused(folder)
