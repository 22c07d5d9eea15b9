import numpy as np

from fastac.sensor.optics import faults

FRAMES = np.random.default_rng(1).integers(40, 200, (3, 16, 20, 4)).astype(np.uint8)


def test_gain_and_offset_saturate_at_the_format():
    assert np.array_equal(faults.gain(FRAMES, 1), FRAMES)
    assert np.array_equal(faults.gain(FRAMES, 0.5), np.rint(FRAMES / 2))
    assert faults.gain(FRAMES, 2).max() == 255
    assert np.array_equal(faults.offset(FRAMES, -3), FRAMES - 3)
    assert faults.offset(FRAMES, -80).min() == 0


def test_one_light_dims_alone():
    found = faults.dimmed(FRAMES, 2, 0)
    assert not found[..., 2].any()
    assert np.array_equal(found[..., [0, 1, 3]], FRAMES[..., [0, 1, 3]])
    assert np.array_equal(faults.dimmed(FRAMES, 1, 0.5)[..., 1], np.rint(FRAMES[..., 1] / 2))


def test_dead_pixels_are_the_same_in_every_frame():
    found = faults.dead_pixels(FRAMES, 0.05)
    changed = (found != FRAMES).any(axis=-1)
    assert changed[0].sum() == 16  # of 320
    assert (changed == changed[0]).all()
    assert set(np.unique(found[0][changed[0]])) == {0, 255}
    assert (found[0][changed[0]] == found[0][changed[0]][:, :1]).all()
    assert np.array_equal(faults.dead_pixels(FRAMES, 0), FRAMES)


def test_defocus_keeps_the_light_and_takes_the_detail():
    found = faults.defocused(FRAMES, 2)
    assert abs(found.mean() - FRAMES.mean()) < 2
    assert (
        np.abs(np.diff(found.astype(int), axis=2)).sum()
        < np.abs(np.diff(FRAMES.astype(int), axis=2)).sum() / 5
    )
    assert np.array_equal(faults.defocused(FRAMES, 0), FRAMES)
