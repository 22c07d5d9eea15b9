import os
import pickle
from functools import partial

import numpy as np
import pytest
from miniatures import pressed, refused_by, tacbench_folder

from fastac.sensor.dataset import read
from fastac.sensor.importers.tacbench import import_folder


@pytest.fixture
def folder(tmp_path):
    return tacbench_folder(tmp_path / "digit")


def imported(folder, **changed):
    given = {"pitch_mm": 0.2, "height_px": 24, "width_px": 32, "progress": False}
    import_folder(folder, output=folder.parent / "out.h5", **given | changed)
    return read(folder.parent / "out.h5")


refused = partial(refused_by, imported)


def test_labelled_images_of_all_batches(folder):
    data = imported(folder)
    loads = np.array([1, 2, 3, 1, 2, 3, 4] * 2)
    np.testing.assert_array_equal(data.group, ["flat/batch_2"] * 7 + ["sphere/batch_1"] * 7)
    np.testing.assert_array_equal(data.split[7:], "test")
    np.testing.assert_array_equal(data.force_n[:, 2], loads)
    np.testing.assert_array_equal(data.force_n[0, :2], [0.5, -0.25])
    # Both batches are on one background, the mean of theirs, though their light differs.
    np.testing.assert_array_equal(data.background[0, 0], [93, 83, 73])
    np.testing.assert_array_equal(data.frames[:, 0, 0, 0], 93)
    np.testing.assert_array_equal(data.frames[:, 8, 10, 0], 93 + 10 * loads)


def test_groups_and_every_so_many(folder):
    assert set(imported(folder, group_by="probe").group) == {"flat", "sphere"}
    data = imported(folder, group_by="stroke", held_out=("flat/batch_2/1",))
    assert data.group[0] == "flat/batch_2/0"
    assert (data.split == "test").sum() == 4
    data = imported(folder, every=3)
    np.testing.assert_array_equal(data.force_n[:, 2], [1, 1, 4] * 2)
    data = imported(folder / "flat" / "batch_2", group_by="stroke")
    np.testing.assert_array_equal(data.group, ["batch_2/0"] * 3 + ["batch_2/1"] * 4)


def test_many_frames_are_kept_in_a_file(folder, monkeypatch):
    frames = imported(folder).frames
    monkeypatch.setattr("fastac.sensor.importers.force_frames.MOST_IN_MEMORY", 0)
    before = sorted(folder.parent.iterdir())
    np.testing.assert_array_equal(imported(folder).frames, frames)
    assert sorted(folder.parent.iterdir()) == before


def test_of_a_stroke_the_last_images_may_lack_forces(folder):
    path = folder / "flat/batch_2/dataset_slip_forces.pkl"
    labels = pickle.loads(path.read_bytes())
    labels["trajectories"][1]["forces"] = labels["trajectories"][1]["forces"][:2]
    path.write_bytes(pickle.dumps(labels))
    assert len(imported(folder)) == 12


def test_bad_labels(folder):
    path = folder / "flat/batch_2/dataset_slip_forces.pkl"
    good = path.read_bytes()

    def change(**changed):
        labels = pickle.loads(good)
        for key, value in changed.items():
            where = labels if key in labels else labels["trajectories"][0]
            where[key] = value
            if value is None:
                del where[key]
        path.write_bytes(pickle.dumps(labels))
        return refused(folder)

    assert "dataset_slip_forces.pkl: trajectories: missing key" in change(trajectories=None)
    assert "trajectories[0]: forces: missing key" in change(forces=None)
    assert "trajectories = list: expected a dict" in change(trajectories=[])
    assert "forces = float64 of shape (3, 2): expected numbers of shape (n, 3)" in change(
        forces=np.zeros((3, 2))
    )
    assert "forces = float64 of shape (1, 3): expected numbers" in change(forces=[[np.nan] * 3])
    assert "forces = object of shape (0,): expected numbers" in change(forces=[[1.0], [1.0, 2.0]])
    assert "trajectories[0]: 0 forces for 9 images" in change(indexes=[3] * 9, forces=np.zeros((0, 3)))
    assert "indexes up to 12: in_contact has 10 images" in change(indexes=[3, 4, 12])
    assert "in_contact = <U1 of shape (1,): expected numbers" in change(in_contact=["x"])
    assert "in_contact: 0 for no image" in change(in_contact=np.ones(10))
    assert "force_z_n = -9 to 4, mostly negative" in change(forces=np.full((3, 3), -9.0))
    assert "the last image is 9: dataset_slip_forces.pkl has forces for image 11" in change(
        indexes=[3, 4, 11], in_contact=np.zeros(12)
    )
    path.write_bytes(pickle.dumps({"in_contact": os.system}))
    assert "dataset_slip_forces.pkl: refused: it holds the name 'posix.system'" in refused(folder)
    path.write_bytes(good[:-20])
    assert "dataset_slip_forces.pkl: damaged or no pickle" in refused(folder)


def test_forces_of_the_other_sign(folder):
    for path in folder.rglob("dataset_slip_forces.pkl"):
        labels = pickle.loads(path.read_bytes())
        for stroke in labels["trajectories"].values():
            stroke["forces"] = -stroke["forces"]
        path.write_bytes(pickle.dumps(labels))
    assert "force_z_n = -4 to -1, mostly negative" in refused(folder)
    assert imported(folder, negate=True).force_n.max() == 4


def test_bad_images(folder):
    path = folder / "flat/batch_2/dataset_digit_01.pkl"
    good = pickle.loads(path.read_bytes())
    for bad, message in (
        (b"\x89PNG", "dataset_digit_01.pkl: image 0: not a readable image"),
        ("text", "dataset_digit_01.pkl: image 0 = str: expected an image"),
        (pressed(1).astype(float), "image 0 = float64 of shape (48, 64, 3): expected an image"),
        (pressed(1, 40), "image 0 = 64 x 40 px: expected the background's 64 x 48 px"),
    ):
        path.write_bytes(pickle.dumps([bad, *good[1:]]))
        assert message in refused(folder), message
    path.write_bytes(pickle.dumps("text"))
    assert "dataset_digit_01.pkl: str: expected a list of images" in refused(folder)
    path.rename(path.with_name("dataset_gelsight_01.pkl"))
    assert "images of digit, gelsight: expected dataset_SENSOR_00.pkl" in refused(folder)
    for file in (folder / "flat/batch_2").glob("dataset_[dg]*"):
        file.unlink()
    assert "images none: expected" in refused(folder)
    (folder / "empty").mkdir()
    assert "no dataset_slip_forces.pkl there or in a folder below it" in refused(folder / "empty")
    assert "none: no such folder" in refused(folder / "none")
