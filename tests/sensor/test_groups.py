"""Frames of one recording or press are one group."""

import numpy as np

from fastac.sensor.groups import groups, left_out_together, several_recordings
from fastac.sensor.samples import Dataset

FRAMES = np.zeros((5, 4, 4, 3), np.uint8)


def dataset(**known) -> Dataset:
    split = np.array(["train"] * 5)
    return Dataset(0.1, ("B", "G", "R"), "test", FRAMES[0], split, frames=FRAMES, **known)


def test_recordings_come_before_places():
    poses = {"x_mm": np.arange(5.0), "y_mm": np.zeros(5)}
    found = groups(dataset(group=np.array(["b", "a", "b", "b", "c"]), indenter=poses))
    assert found.tolist() == [1, 0, 1, 1, 2]


def test_frames_at_one_place_are_one_press():
    poses = {"x_mm": np.array([1.0, 1, 2, np.nan, np.nan]), "y_mm": np.array([0.5, 0.5, 0.5, np.nan, np.nan])}
    found = groups(dataset(indenter=poses))
    assert found[0] == found[1]
    assert len(set(found.tolist())) == 4, "frames without contact are groups of their own"


def test_without_either_each_frame_is_a_group():
    assert groups(dataset()).tolist() == [0, 1, 2, 3, 4]
    assert groups(dataset(indenter={"ball_mm": np.ones(5)})).tolist() == [0, 1, 2, 3, 4]


def test_recordings_are_left_out_whole():
    data = dataset(group=np.array(["b", "a", "b", "c", "c"]))
    data.split[:] = ["train", "validation", "train", "train", "test"]
    assert several_recordings(data)
    assert left_out_together(data).tolist() == [1, 0, 1, 2, -1]


def test_of_one_recording_stretches_of_neighbours_are_left_out():
    """Whatever split they are in; another recording that is the test split does not count."""
    frames = np.zeros((24, 4, 4, 3), np.uint8)
    split = np.array([*["train"] * 12, *["test"] * 4, *["validation"] * 8])
    expected = np.array([*np.arange(12) // 4, *[-1] * 4, *np.arange(12, 20) // 4])
    for group in (None, np.where(split == "test", "b", "a")):
        data = Dataset(0.1, ("B", "G", "R"), "test", frames[0], split, frames=frames, group=group)
        assert not several_recordings(data)
        assert left_out_together(data).tolist() == expected.tolist()
