"""Labels against the slopes that frames show without them."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.models.training.shown_slopes import MOST_FRAMES, agreement, doubt
from fastac.sensor.geometry import normals_from_slopes
from fastac.sensor.samples import Dataset


@pytest.fixture(scope="module")
def labelled(dents):
    """120 frames of dents under three lights, each a little brighter than the background by itself."""
    slopes, mixing = dents
    slopes = slopes / np.abs(slopes).max()
    rng = np.random.default_rng(2)
    shade = 128 + 100 * slopes @ mixing / np.abs(mixing).max()
    shade += rng.uniform(-5, 5, (len(slopes), 1, 1, 3)) + rng.standard_normal(shade.shape)
    return Dataset(
        pitch_mm=0.1,
        channels=("B", "G", "R"),
        source="simulated: dents",
        background=np.full((24, 24, 3), 128, np.uint8),
        split=np.full(len(slopes), "train"),
        frames=np.clip(np.rint(shade), 0, 255).astype(np.uint8),
        normals=normals_from_slopes(slopes[..., 0], slopes[..., 1]).astype(np.float32),
    )


def test_labels_that_fit(labelled):
    found = agreement(labelled)
    assert np.diagonal(found).min() > 0.9
    assert doubt(found) is None


def test_invalid_pixels_do_not_count(labelled):
    valid = labelled.frames.max(axis=-1) > 138
    normals = np.where(valid[..., None], labelled.normals, np.nan)
    assert np.diagonal(agreement(replace(labelled, normals=normals, valid=valid))).min() > 0.9


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_labels(labelled, axis):
    normals = labelled.normals.copy()
    normals[..., axis] *= -1
    assert doubt(agreement(replace(labelled, normals=normals))) == "the labels seem mirrored along one axis"


def test_exchanged_labels(labelled):
    found = agreement(replace(labelled, normals=labelled.normals[..., [1, 0, 2]]))
    assert doubt(found) == "x and y of the labels seem exchanged"


def test_few_frames_of_many_are_looked_at(labelled):
    """Later frames without a label change nothing: only labelled ones are chosen from."""
    valid = np.zeros(labelled.frames.shape[:3], bool)
    valid[:MOST_FRAMES] = True
    some = {key: getattr(labelled, key)[:MOST_FRAMES] for key in ("frames", "normals", "split")}
    np.testing.assert_array_equal(
        agreement(replace(labelled, valid=valid)), agreement(replace(labelled, **some))
    )


def test_nothing_can_be_said(labelled):
    assert agreement(replace(labelled, normals=None)) is None
    assert agreement(replace(labelled, frames=labelled.frames[..., :1])) is None
    assert agreement(replace(labelled, valid=np.zeros(labelled.frames.shape[:3], bool))) is None
    flat = np.broadcast_to(labelled.background, labelled.frames.shape)
    assert agreement(replace(labelled, frames=flat)) is None
