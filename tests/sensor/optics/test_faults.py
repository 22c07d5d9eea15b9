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


SKIN, PAINT = 150, 15
CENTRES = np.array([[(10.0, 8.0), (26.0, 8.0)], [(11.0, 9.0), (26.0, 7.0)]])


def with_dots():
    frames = np.full((2, 24, 36, 3), SKIN, np.uint8)
    v, u = np.indices((24, 36))
    for frame, centres in zip(frames, CENTRES, strict=True):
        for x, y in centres:
            frame[np.hypot(u - x, v - y) <= 2] = PAINT
    return frames


def dark(frames):
    return (frames == PAINT).all(axis=-1).sum(axis=(1, 2))


def test_covered_dots_are_skin_and_others_stay():
    frames = with_dots()
    found = faults.covered_dots(frames, CENTRES[:, :1], 2)
    assert np.array_equal(dark(found), dark(frames) // 2)
    assert (found[0, 4:13, 6:15] == SKIN).all()
    assert np.array_equal(faults.covered_dots(frames, CENTRES[:, :0], 2), frames)


def test_smeared_dots_are_three_times_as_wide():
    frames = with_dots()
    found = faults.smeared_dots(frames, CENTRES[:, :1], 2)
    row = (found[0, 8] == PAINT).all(axis=-1)
    assert np.flatnonzero(row)[:13].tolist() == [*range(4, 17)]
    assert np.array_equal(found[:, :, 20:], frames[:, :, 20:])


def test_added_dots_are_dark():
    frames = with_dots()
    found = faults.added_dots(frames, CENTRES[:, :1] + (8, 0), 2, value=PAINT)
    assert np.array_equal(dark(found), dark(frames) // 2 * 3)
