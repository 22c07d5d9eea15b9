import pickle
from functools import partial

import numpy as np
import pytest
from miniatures import GEL, estimate_modulus_folder, refused_by

from fastac.sensor.dataset import read
from fastac.sensor.importers.estimate_modulus import import_folder


@pytest.fixture
def folder(tmp_path):
    return estimate_modulus_folder(tmp_path / "2023-12-16")


def imported(folder, **changed):
    given = {"background_frames": 2, "pitch_mm": 0.2, "height_px": 24, "width_px": 32, "progress": False}
    import_folder(folder, output=folder.parent / "out.h5", **given | changed)
    return read(folder.parent / "out.h5")


refused = partial(refused_by, imported)


def test_grasps_of_an_object_are_a_group(folder):
    data = imported(folder)
    np.testing.assert_array_equal(data.group, ["foam_brick"] * 6 + ["golf_ball"] * 12)
    np.testing.assert_array_equal(data.force_n[:, 0], [0, 0, 1, 2, 3, 4] * 3)
    assert data.force_axes == ("z",)
    assert set(data.split[data.group == "golf_ball"]) == {"test"}  # the last


def test_each_grasp_has_a_background_of_its_own(folder):
    """One is brighter from rest on: against its own background it is as the other."""
    data = imported(folder)
    np.testing.assert_array_equal(data.frames[6:12], data.frames[12:])
    np.testing.assert_array_equal(data.background[0, 0], np.array(GEL[::-1]) + 2)  # the mean of 0, 6 and 0
    change = data.frames[:6].astype(int) - data.background
    np.testing.assert_array_equal(change[:, 8, 12, 0], [0, 0, 10, 20, 30, 40])


def test_a_part_of_each_frame(folder):
    data = imported(folder, crop_px=(16, 12, 16, 12), height_px=16, width_px=16)
    change = data.frames[:6].astype(int) - data.background
    assert (change[5, 3:13] == 40).all()  # twelve rows of sixteen, the others are padding
    for crop_px in ((-1, 0, 16, 12), (0, 0, 65, 12), (0, 40, 16, 12), (0, 0, 0, 12)):
        (folder.parent / "out.h5").unlink(missing_ok=True)
        assert "not inside the frame's 64 x 48 px" in refused(folder, crop_px=crop_px)


def test_older_numbers_are_no_part_of_the_object(folder):
    for path in list(folder.iterdir()):
        path.rename(folder / path.name.replace("__t=", "_"))
    assert set(imported(folder).group) == {"foam_brick", "golf_ball"}


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ([0.0] * 5 + [3.0, 4.0], "golf_ball__t=0.avi: 6 frames: expected one for 7 forces"),
        ([0.0, 0.0, 1.0, 2.0, 3.0], "golf_ball__t=0.avi: frame 5: no force, there are 5"),
        ([0.0] * 5 + [float("nan")], "golf_ball__t=0.avi: frame 5: force (nan,) N: expected numbers"),
        ({"z": 1.0}, "golf_ball__t=0_forces.pkl: expected a list of forces, N"),
        (["a", "b"], "golf_ball__t=0_forces.pkl: expected a list of forces, N"),
        ([0.0], "background_frames = 2: expected 1 to 1"),
    ],
)
def test_forces_that_are_none(folder, forces, message):
    (folder / "golf_ball__t=0_forces.pkl").write_bytes(pickle.dumps(forces))
    assert message in refused(folder)


def test_forces_of_the_other_sign(folder):
    """As in the project's oldest folders."""
    for path in folder.glob("*_forces.pkl"):
        path.write_bytes(pickle.dumps([-force for force in pickle.loads(path.read_bytes())]))
    assert "expected positive values in compression (--negate" in refused(folder)
    np.testing.assert_array_equal(imported(folder, negate=True).force_n[:, 0], [0, 0, 1, 2, 3, 4] * 3)


def test_videos_that_are_later_than_forces(folder):
    """Forces 0, 0, 1, 2, 3, 4 of six frames; the first and the last of either have no partner."""
    for late, expected in ((2, [0, 0, 1, 2]), (-1, [0, 1, 2, 3, 4])):
        data = imported(folder, delay_frames=late)
        np.testing.assert_array_equal(data.force_n[:, 0], expected * 3)
        every = imported(folder)
        first = every.frames[2:6] if late > 0 else every.frames[:5]
        np.testing.assert_array_equal(data.frames[: len(expected)], first)


def test_delays_of_more_frames_than_there_are(folder):
    for late in (-6, 7):
        assert f"delay_frames = {late}: expected less than its 6 frames" in refused(folder, delay_frames=late)


def test_what_is_missing(folder):
    (folder / "golf_ball__t=1_forces.pkl").unlink()
    assert "golf_ball__t=1_forces.pkl" in refused(folder)
    for path in folder.iterdir():
        path.unlink()
    assert "no grasps: expected videos such as golf_ball__t=0.avi" in refused(folder)
    folder.rmdir()
    assert "no such folder" in refused(folder)
