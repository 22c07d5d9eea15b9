"""Depth from absolute slopes with and without its boundary, of surfaces that the equation holds exactly."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.studies.reproduce.geometry import absolute_depth_mm, rgb_data, rgb_scene, without_mean_error
from fastac.studies.reproduce.section import one_ball, vertical


@pytest.fixture
def paraboloid(make_scene):
    """A scene, a surface (16, 16) of which central differences are exact, and its slopes."""
    scene = make_scene()
    v, u = np.indices((16, 16)) * scene.sensor.pitch_mm
    depth = 1 + 0.3 * u - 0.2 * v + 0.1 * u**2 + 0.05 * u * v - 0.04 * v**2
    slopes = np.stack([0.3 + 0.2 * u + 0.05 * v, -0.2 + 0.05 * u - 0.08 * v], axis=-1)
    return scene, depth, slopes


def test_with_the_prior_the_surface_itself(paraboloid):
    scene, depth, slopes = paraboloid
    found = absolute_depth_mm(np.stack([slopes, 2 * slopes]), scene, depth)
    np.testing.assert_allclose(found[0], depth, atol=1e-12)
    np.testing.assert_array_equal(found[1][0], depth[0])


def test_without_it_what_is_added_is_harmonic_and_zero_on_the_boundary(paraboloid):
    scene, depth, slopes = paraboloid
    found = absolute_depth_mm(slopes[None], scene, None)[0]
    for edge in (found[0], found[-1], found[:, 0], found[:, -1]):
        assert not edge.any()
    added = found - depth
    laplacian = (
        added[2:, 1:-1] + added[:-2, 1:-1] + added[1:-1, 2:] + added[1:-1, :-2] - 4 * added[1:-1, 1:-1]
    )
    np.testing.assert_allclose(laplacian, 0, atol=1e-12)
    assert np.abs(added[1:-1, 1:-1]).mean() > 0.5


def test_less_each_frame_s_mean():
    truth = np.random.default_rng(1).normal(size=(2, 5, 5))
    moved = truth + np.array([0.5, -2.0])[:, None, None]
    np.testing.assert_allclose(without_mean_error(moved, truth), truth)


def test_rgb_is_the_recording_without_nir(tiny_data, tiny_scene):
    scene, data = rgb_scene(tiny_scene), rgb_data(tiny_data)
    assert scene.sensor.channel_names == data.channels == ("B", "G", "R")
    assert scene.model_copy(update={"sensor": tiny_scene.sensor}) == tiny_scene
    np.testing.assert_array_equal(data.frames, tiny_data.frames[..., :3])
    np.testing.assert_array_equal(data.background, tiny_data.background[..., :3])
    assert data.normals is tiny_data.normals


def test_the_papers_protocol_has_the_ball_of_the_test_presses(tiny_data):
    for split in ("train", "test"):
        np.testing.assert_array_equal(one_ball(tiny_data, split), tiny_data.indices(split))
    index = tiny_data.indices("train")
    ball_mm = np.array(tiny_data.indenter["ball_mm"])
    ball_mm[index[1::2]] = 20.0
    others = replace(tiny_data, indenter={**tiny_data.indenter, "ball_mm": ball_mm})
    np.testing.assert_array_equal(one_ball(others, "train"), index[::2])
    bare = replace(tiny_data, indenter=None)
    np.testing.assert_array_equal(one_ball(bare, "train"), index)


def test_without_tangential_loads_all_presses_are_vertical(tiny_data):
    np.testing.assert_array_equal(vertical(tiny_data, "test"), tiny_data.indices("test"))
