from dataclasses import replace

import numpy as np
import pytest

from fastac.models.training.force.light import under_other_light


@pytest.fixture
def data(tiny_data):
    """Frames of one brightness each, so that a gain can be read from a pixel."""
    brightness = np.linspace(60, 250, len(tiny_data)).astype(np.uint8)
    frames = np.broadcast_to(brightness[:, None, None, None], tiny_data.frames.shape)
    return replace(tiny_data, frames=np.ascontiguousarray(frames))


def test_each_channel_of_each_known_frame_has_a_gain_of_its_own(data):
    found = under_other_light(data, 0.1, seed=1)
    known = data.split != "test"
    first = found.frames[:, :1, :1].astype(float)
    np.testing.assert_array_equal(found.frames, np.broadcast_to(first, found.frames.shape))
    gains = (first / data.frames[:, :1, :1])[known]
    clear = first[known] < 255
    assert gains[clear].std() == pytest.approx(0.1, rel=0.3)
    assert np.abs(gains[clear].mean() - 1) < 0.05
    assert len(np.unique(gains[:, 0, 0], axis=0)) == known.sum()


def test_bright_pixels_saturate_instead_of_turning_dark(data):
    bright = replace(data, frames=np.full_like(data.frames, 255))
    found = under_other_light(bright, 0.1, seed=1).frames[data.split == "train"]
    assert (found == 255).any()
    assert found.min() > 128


def test_background_and_test_frames_stay(data):
    found = under_other_light(data, 0.1, seed=1)
    test = data.indices("test")
    np.testing.assert_array_equal(found.frames[test], data.frames[test])
    assert found.background is data.background


def test_gains_follow_from_the_seed(data):
    one, again, other = (under_other_light(data, 0.1, seed).frames for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_without_noise_it_is_the_same_dataset(data):
    assert under_other_light(data, 0.0, seed=1) is data
