from dataclasses import replace

import numpy as np
import pytest

from fastac.tune.groups import TuneError, folds_of, names_of, units_of


def test_units_are_groups_or_presses(tiny_data):
    count = len(tiny_data)
    group = np.array(["a", "b", "c"])[np.arange(count) % 3]
    assert names_of(units_of(replace(tiny_data, group=group))) == ["a", "b", "c"]
    by_press = units_of(replace(tiny_data, group=group), "press")
    assert len(names_of(by_press)) > 3
    two = np.where(group == "c", "a", group)
    assert len(names_of(units_of(replace(tiny_data, group=two)))) > 3  # too few groups to fold
    assert names_of(units_of(replace(tiny_data, group=two), "group")) == ["a", "b"]
    with pytest.raises(TuneError, match=r"^group: missing"):
        units_of(tiny_data, "group")


def test_frames_at_rest_are_of_no_unit(tiny_data):
    frames = tiny_data.frames.copy()
    frames[4] = tiny_data.background
    group = np.array(["a", "b", "c"])[np.arange(len(frames)) % 3]
    for known in (group, None):
        assert units_of(replace(tiny_data, frames=frames, group=known))[4] == ""


def test_forces_tell_presses_apart(tiny_data):
    """Three pushes with nothing between them; places are unknown."""
    force = np.zeros((len(tiny_data), 3))
    force[[2, 3, 4, 9, 10, 20], 2] = [1, 3, 2, -1, 2, 1]
    found = units_of(replace(tiny_data, force_n=force, indenter=None))
    assert names_of(found) == ["press 1", "press 2", "press 3"]
    assert found[:20].tolist() == ["press 1"] * 9 + ["press 2"] * 11


def test_without_places_and_forces_each_frame_is_a_press(tiny_data):
    found = units_of(replace(tiny_data, force_n=None, indenter=None))
    assert len(names_of(found)) == len(tiny_data)


def test_folds():
    units = np.array(["", *"aaaaaaaaabcdeeffgg"])
    folds = folds_of(units, 3, seed=1)
    assert sorted(name for fold in folds for name in fold) == list("abcdefg")
    assert ["a"] in folds
    assert folds_of(units, 3, seed=1) == folds
    assert len({str(folds_of(units, 7, seed=k)) for k in range(9)}) > 1
    with pytest.raises(TuneError, match=r"^7 groups or presses for 8 folds"):
        folds_of(units, 8, seed=1)
    with pytest.raises(TuneError, match=r"^folds = 2: expected 3 or more$"):
        folds_of(units, 2, seed=1)
