"""Which pixels a share of those at rest leaves to train on."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.flow.training import skin_alone
from fastac.models.training.labelled_pixels import training_pixels
from fastac.models.training.moved_pixels import moved_or_chosen
from fastac.sensor.geometry import normals_from_slopes, rest_slopes


@pytest.fixture
def pressed(tiny_data, tiny_scene):
    """The tiny data with slopes at rest everywhere but in rows 4 and 5 of each frame, and rows that move."""
    p, q = rest_slopes(tiny_scene.sensor)
    normals = np.broadcast_to(normals_from_slopes(p, q), tiny_data.normals.shape).astype(np.float32)
    p[4:6] += 0.05
    normals[:, 4:6] = normals_from_slopes(p, q)[4:6]
    moved = np.zeros(normals.shape[:3], bool)
    moved[:, 4:6] = True
    return replace(tiny_data, normals=normals), moved


def test_all_that_moves_and_a_share_of_the_rest(pressed, tiny_scene):
    data, moved = pressed
    np.testing.assert_array_equal(moved_or_chosen(data, tiny_scene.sensor, 0.0, 1), moved)
    found = moved_or_chosen(data, tiny_scene.sensor, 0.25, 1)
    assert found[moved].all()
    assert found[~moved].mean() == pytest.approx(0.25, abs=0.02)
    np.testing.assert_array_equal(found, moved_or_chosen(data, tiny_scene.sensor, 0.25, 1))
    assert (found != moved_or_chosen(data, tiny_scene.sensor, 0.25, 2)).any()


def test_the_share_is_the_scenes_and_pixels_without_a_label_stay_out(pressed, make_scene):
    data, moved = pressed
    valid = np.random.default_rng(1).random(moved.shape) < 0.5
    everything, none_at_rest = make_scene(), make_scene(training={"still_share": 0.0})
    assert skin_alone(data, everything) is data
    np.testing.assert_array_equal(skin_alone(data, none_at_rest).valid, moved)
    known = skin_alone(replace(data, valid=valid), none_at_rest)
    np.testing.assert_array_equal(known.valid, moved & valid)


def test_shares_of_pixels_are_drawn_each_by_itself(pressed, make_scene):
    data, moved = pressed
    both = make_scene(training={"still_share": 0.4, "normals_share": 0.5})
    x, _ = training_pixels(skin_alone(data, both), both.training)
    train = data.indices("train")
    expected = 0.5 * (moved[train].sum() + 0.4 * (~moved[train]).sum())
    assert len(x) == pytest.approx(expected, rel=0.05)
