import os
from functools import partial

import numpy as np
import pytest
from miniatures import feats_folder, pressed, refused_by
from PIL import Image

from fastac.sensor.dataset import read
from fastac.sensor.importers.feats import import_folder


@pytest.fixture
def folder(tmp_path):
    return feats_folder(tmp_path / "labels")


def imported(folder, **changed):
    given = {"pitch_mm": 0.2, "height_px": 24, "width_px": 32, "progress": False}
    background = changed.pop("background", folder / "rest.npy")
    import_folder(folder, background, output=folder.parent / "out.h5", **given | changed)
    return read(folder.parent / "out.h5")


refused = partial(refused_by, imported)


def test_frames_forces_and_splits(folder):
    data = imported(folder)
    np.testing.assert_array_equal(data.split, ["train"] * 3 + ["validation"] + ["test"] * 2)
    np.testing.assert_array_equal(data.group, ["cuboid_10"] * 2 + ["sphere_6"] * 2 + ["ring"] * 2)
    np.testing.assert_allclose(data.force_n[:, 2], 1 + np.arange(6))  # z is negative in FEATS
    np.testing.assert_allclose(data.force_n[0, :2], [0.1, -0.2])
    np.testing.assert_array_equal(data.background[0, 0], [90, 80, 70])  # B, G, R
    np.testing.assert_array_equal(
        data.frames[:, 8, 10], data.background[8, 10] + 10 * np.arange(1, 7)[:, None]
    )
    assert data.normals is None
    assert data.pitch_mm == 0.2


def test_held_out_groups_go_before_the_folders(folder):
    data = imported(folder, held_out=("sphere_6",))
    np.testing.assert_array_equal(data.split, ["train"] * 2 + ["test"] * 2 + ["train"] * 2)
    (folder.parent / "out.h5").unlink()
    assert "group 'ball': expected one of cuboid_10, sphere_6, ring" in refused(folder, held_out=("ball",))
    assert "group: all 3 are held out" in refused(folder, held_out=("ring", "cuboid_10", "sphere_6"))


def test_raw_recordings_of_one_folder(tmp_path):
    folder = tmp_path / "raw"
    folder.mkdir()
    for k, indenter in enumerate(("bar", "bar", "moon", "moon")):
        force = {"f_x": 0.0, "f_y": 0.0, "f_z": -float(k)}
        np.save(folder / f"20240101-10000{k}.npy", {"gs_img": pressed(k), "indenter": indenter, **force})
    Image.fromarray(pressed(0)).save(tmp_path / "rest.png")
    data = imported(folder, background=tmp_path / "rest.png", every=1)
    np.testing.assert_array_equal(data.group, ["bar", "bar", "moon", "moon"])
    np.testing.assert_array_equal(data.split, ["train", "train", "test", "test"])
    assert len(imported(folder, background=tmp_path / "rest.png", every=2)) == 2


def test_errors(folder, tmp_path):
    path = folder / "train" / "0_1744012609_cuboid_10.npy"
    good = {"gs_img": pressed(1), "f_x": 0.0, "f_y": 0.0, "f_z": -1.0}
    for changed, message in (
        ({"gs_img": pressed(1)[..., 0]}, "gs_img = uint8 of shape (48, 64): expected an image"),
        ({"gs_img": [1]}, "gs_img = list: expected an image"),
        ({"gs_img": pressed(1, 40)}, "gs_img = 64 x 40 px: expected the background's 64 x 48 px"),
        ({"f_y": "1"}, "f_y = str: expected a number"),
        ({"f_z": np.nan}, "expected numbers"),
        ({"f_z": 90.0}, "force_z_n = -90 to 6, mostly negative"),
    ):
        np.save(path, good | changed)
        assert message in refused(folder), message
    np.save(path, {key: value for key, value in good.items() if key != "f_z"})
    assert "0_1744012609_cuboid_10.npy: f_z: missing key" in refused(folder)
    np.save(path, np.zeros(3))
    assert "0_1744012609_cuboid_10.npy: an array: expected a dict" in refused(folder)
    np.save(path, {"gs_img": os.system})
    assert "0_1744012609_cuboid_10.npy: refused: it holds the name 'posix.system'" in refused(folder)
    np.save(path, good)
    assert "the pattern 'x+' finds no group in this name" in refused(folder, group_pattern="x+")
    assert "group pattern '('" in refused(folder, group_pattern="(")
    assert "pitch_mm = 0: expected more than 0" in refused(folder, pitch_mm=0.0)
    assert "nothing.npy: no such file" in refused(folder, background=tmp_path / "nothing.npy")
    (tmp_path / "empty").mkdir()
    assert "no frames: expected .npy files" in refused(tmp_path / "empty", background=folder / "rest.npy")
