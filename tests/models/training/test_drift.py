"""Drifted frames change, and no measure of their pixels flags them."""

from dataclasses import replace

import numpy as np

from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.training.drift import drifted

SHAPE = (16, 20, 3)


def test_drifts_stay_within_the_limits():
    rng = np.random.default_rng(1)
    background = rng.integers(60, 200, SHAPE).astype(np.uint8)
    touched = np.clip(background + rng.integers(-30, 31, (6, *SHAPE)) * (rng.random(SHAPE) < 0.2), 0, 255)
    frames = np.concatenate([touched.astype(np.uint8)] * 5)
    open_ = FrameValidity.unlimited(SHAPE, slopes=True, displacements=False)
    seen = np.array([[*open_.of_pixels(frame, background), 0] for frame in frames])
    validity = open_.limited(seen)
    found = drifted(frames, background, validity, seed=1)
    assert found.dtype == np.uint8
    measures = np.array([[*validity.of_pixels(frame, background), 0] for frame in found])
    assert not validity.flags(measures).any()
    # Most of the room that the limits leave is used, on both sides.
    brightness = measures[:, 1:4] / validity.high[1:4]
    assert brightness.max() > 0.6
    assert (measures[:, 1:4] / validity.low[1:4]).max() > 0.6
    assert np.abs(found.astype(int) - frames).max() < 20
    assert not np.array_equal(found[0], found[6]), "frames drift differently"
    np.testing.assert_array_equal(found, drifted(frames, background, validity, seed=1))


def test_without_room_frames_stay_as_they_are():
    background = np.full(SHAPE, 100, np.uint8)
    validity = FrameValidity.unlimited(SHAPE, slopes=False, displacements=False)
    nothing = np.zeros_like(validity.high)
    validity = replace(validity, low=nothing, high=nothing)
    frames = background[None].repeat(3, axis=0)
    np.testing.assert_array_equal(drifted(frames, background, validity, seed=1), frames)
