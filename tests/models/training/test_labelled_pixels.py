from dataclasses import replace

import numpy as np
import pytest

from fastac.models.integer.features import integer_features
from fastac.models.training.labelled_pixels import labelled_pixels, labelled_splits


def with_background(data, split: str = "train"):
    """The dataset with the background added as a flat sample, as the importer of ball presses does."""
    flat = np.zeros((1, *data.normals.shape[1:]), np.float32)
    flat[..., 2] = 1
    return replace(
        data,
        frames=np.concatenate([data.frames, data.background[None]]),
        normals=np.concatenate([data.normals, flat]),
        split=np.append(data.split, split),
        depth_mm=None,
        force_n=None,
        indenter=None,
    )


def test_all_pixels_of_the_split(tiny_data):
    x, y = labelled_pixels(tiny_data, "validation")
    index = tiny_data.indices("validation")
    expected_x = integer_features(tiny_data.frames[index], tiny_data.background).reshape(len(x), -1)
    expected_y = tiny_data.normals[index].reshape(-1, 3)
    np.testing.assert_array_equal(x, expected_x)
    np.testing.assert_allclose(y, expected_y, atol=1e-7)
    assert len(x) == 8 * 16 * 16


def test_differences_are_smoothed_before_pixels_are_chosen(tiny_data):
    index = tiny_data.indices("train")
    expected = integer_features(tiny_data.frames[index], tiny_data.background, 4).reshape(-1, 6)
    x, _ = labelled_pixels(tiny_data, "train", smoothing_px=4)
    np.testing.assert_array_equal(x, expected)
    assert (x != labelled_pixels(tiny_data, "train")[0]).any()


def test_what_is_not_valid_is_left_out(tiny_data):
    valid = np.random.default_rng(1).random(tiny_data.frames.shape[:3]) < 0.1
    normals = np.where(valid[..., None], tiny_data.normals, np.nan)
    x, y = labelled_pixels(replace(tiny_data, valid=valid, normals=normals), "train")
    index = tiny_data.indices("train")
    assert len(x) == valid[index].sum()
    assert np.isfinite(y).all()
    expected = integer_features(tiny_data.frames[index], tiny_data.background)[valid[index]]
    np.testing.assert_array_equal(x, expected)


def test_a_share_is_drawn_from_every_frame_by_the_seed(tiny_data):
    every, _ = labelled_pixels(tiny_data, "train")
    x, y = labelled_pixels(tiny_data, "train", share=0.25, seed=3)
    assert len(x) / len(every) == pytest.approx(0.25, abs=0.02)
    frames = len(tiny_data.indices("train"))
    whole = every.reshape(frames, -1, every.shape[-1])
    known = {tuple(pixel) for frame in whole for pixel in frame.tolist()}
    assert {tuple(pixel) for pixel in x.tolist()} <= known
    # Each frame has its own pixels: places differ, and all parts of the image are there.
    assert len(np.unique(x[:, 4:], axis=0)) > 0.9 * len(np.unique(every[:, 4:], axis=0))
    same, _ = labelled_pixels(tiny_data, "train", share=0.25, seed=3)
    other, _ = labelled_pixels(tiny_data, "train", share=0.25, seed=4)
    np.testing.assert_array_equal(x, same)
    assert x.shape != other.shape or (x != other).any()
    assert len(x) == len(y)


def test_the_scene_s_share_thins_what_is_trained_on_and_not_what_judges(tiny_data, tiny_scene):
    whole = labelled_splits(tiny_data, tiny_scene.training)
    thinned = labelled_splits(tiny_data, tiny_scene.training.model_copy(update={"normals_share": 0.25}))
    assert len(thinned["train"][0]) / len(whole["train"][0]) == pytest.approx(0.25, abs=0.02)
    np.testing.assert_array_equal(thinned["validation"][0], whole["validation"][0])


def test_a_share_keeps_the_share_at_rest(tiny_data):
    data = with_background(tiny_data)
    x, y = labelled_pixels(data, "train", share=0.5, flat_fraction=0.2, seed=3)
    flat = (x[:, :4] == 0).all(axis=1) & (y == (0, 0, 1)).all(axis=1)
    whole, _ = labelled_pixels(data, "train", share=0.5, seed=3)
    contact = len(whole) - 128  # of the frame at rest about half of 256 pixels
    assert flat.sum() == pytest.approx(min(0.25 * contact, 128), abs=20)


def test_a_share_that_leaves_nothing_is_named(tiny_data):
    message = (
        "valid: no pixel .* is labelled in 'train', or training.normals_share = 1e-09 leaves none of them"
    )
    with pytest.raises(ValueError, match=message):
        labelled_pixels(tiny_data, "train", share=1e-9)


@pytest.mark.parametrize("fraction", [0.05, 0.2, 0.5])
def test_flat_fraction_is_a_share_of_the_result(tiny_data, fraction):
    valid = np.ones((len(tiny_data) + 1, 16, 16), bool)
    valid[:-1, 2:] = False  # two rows of each contact: 18·32 pixels against 256 flat ones
    data = replace(with_background(tiny_data), valid=valid)
    x, y = labelled_pixels(data, "train", flat_fraction=fraction, seed=3)
    flat = (x[:, :4] == 0).all(axis=1) & (y == (0, 0, 1)).all(axis=1)
    if fraction < 0.3:
        assert flat.sum() / len(x) == pytest.approx(fraction, abs=0.003)
    else:
        assert flat.sum() == 256  # there are no more
    again, _ = labelled_pixels(data, "train", flat_fraction=fraction, seed=3)
    other, _ = labelled_pixels(data, "train", flat_fraction=fraction, seed=4)
    np.testing.assert_array_equal(x, again)
    assert fraction > 0.3 or (x != other).any()


def test_a_flat_fraction_of_zero_keeps_all_of_the_background(tiny_data):
    x, _ = labelled_pixels(with_background(tiny_data), "train")
    assert len(x) == 19 * 256


def test_margins_and_the_skin_beyond_circles(tiny_data):
    data = with_background(tiny_data)
    count, circled = len(data), data.indices("train")[:-1]
    circles = {"center_px": np.full((count, 2), 7.5), "radius_px": np.full(count, 4.0)}
    circles["radius_px"][-1] = np.nan
    v, u = np.indices((16, 16))
    distance = np.hypot(u - 7.5, v - 7.5)
    data = replace(data, indenter=circles, valid=np.ones((count, 16, 16), bool))
    data.valid[:-1] &= distance <= 4
    x, y = labelled_pixels(data, "train", circle_margin=0.25, flat_beyond=2.0)
    inside, beyond = int((distance <= 3).sum()), int((distance > 8).sum())
    assert len(x) == len(circled) * (inside + beyond) + 256
    corners = x[-len(circled) * beyond :]
    assert (np.abs(corners[:, -2:]) > 20).any(axis=1).all()
    assert (y[-len(corners) :] == (0, 0, 1)).all()
    expected = integer_features(data.frames[circled[0]], data.background)[distance > 8]
    np.testing.assert_array_equal(corners[:beyond], expected)

    x, _ = labelled_pixels(data, "train", circle_margin=0.25, flat_beyond=2.0, share=0.5)
    thinned = (np.abs(x[:, -2:]) > 60).all(axis=1).sum() / (np.abs(corners[:, -2:]) > 60).all(axis=1).sum()
    assert thinned == pytest.approx(0.5, abs=0.1)

    x, y = labelled_pixels(data, "train", flat_fraction=0.2, flat_beyond=2.0, seed=3)
    flat = (y == (0, 0, 1)).all(axis=1)
    assert flat.sum() / len(x) == pytest.approx(0.2, abs=0.003)
    resting = flat & (x[:, :4] == 0).all(axis=1)
    assert resting.sum() / flat.sum() == pytest.approx(0.5, abs=0.1)

    with pytest.raises(ValueError, match="no circle is in 'train'"):
        labelled_pixels(replace(data, indenter=None), "train", flat_beyond=2.0)


def test_what_cannot_be_learned_from(tiny_data):
    with pytest.raises(ValueError, match="normals: missing"):
        labelled_pixels(replace(tiny_data, normals=None), "train")
    train_only = replace(tiny_data, split=np.full(len(tiny_data), "train"))
    with pytest.raises(ValueError, match="no frame in contact is in 'test'"):
        labelled_pixels(train_only, "test")
    flat_only = with_background(replace(tiny_data, split=np.full(len(tiny_data), "test")))
    with pytest.raises(ValueError, match="no frame in contact is in 'train'"):
        labelled_pixels(flat_only, "train")
    unknown = replace(tiny_data, valid=np.zeros(tiny_data.frames.shape[:3], bool))
    with pytest.raises(ValueError, match="no pixel of a frame in contact is labelled in 'train'"):
        labelled_pixels(unknown, "train")
