import numpy as np
import pytest

from fastac.sensor.importers.resample import Resampling, overlaps


def test_overlaps_are_exact_areas():
    np.testing.assert_allclose(overlaps(5, 2, 2.5) * 2.5, [[1, 1, 0.5, 0, 0], [0, 0, 0.5, 1, 1]])
    np.testing.assert_allclose(overlaps(2, 4, 1.0), [[0, 0], [1, 0], [0, 1], [0, 0]])


@pytest.mark.parametrize(("height", "width"), [(320, 240), (240, 320), (321, 239), (128, 128)])
def test_means_are_kept_and_padding_is_the_background(height, width):
    resampling = Resampling(height, width, 128, 128)
    rng = np.random.default_rng(0)
    background = rng.random((height, width, 3))
    image = rng.random((height, width, 3))
    valid = resampling.valid()
    out = resampling.frame(image, background)
    rest = resampling.background(background)
    np.testing.assert_allclose(
        (out - rest).sum(axis=(0, 1)) * resampling.scale**2, (image - background).sum(axis=(0, 1))
    )
    assert valid.sum() == pytest.approx(128 * 128 * min(height, width) / max(height, width), rel=0.02)
    padding = np.abs(out - rest).max(axis=-1) == 0
    assert not padding[valid].any()
    assert rest.min() >= 0
    assert rest.max() <= 1


def test_padding_repeats_the_edge():
    resampling = Resampling(4, 2, 4, 4)
    image = np.arange(8.0).reshape(4, 2, 1)
    np.testing.assert_allclose(resampling.background(image)[1, :, 0], [2, 2, 3, 3])


def test_a_spot_lands_where_points_px_says():
    resampling = Resampling(320, 240, 128, 128)
    v, u = np.indices((320, 240))
    spot = np.exp(-((u - 76) ** 2 + (v - 182) ** 2) / 200)[..., None]
    out = resampling.frame(spot, np.zeros_like(spot))[..., 0]
    rows, columns = np.indices(out.shape)
    centre = [(out * columns).sum() / out.sum(), (out * rows).sum() / out.sum()]
    np.testing.assert_allclose(resampling.points_px(np.array([76, 182])), centre, atol=1e-6)


@pytest.mark.parametrize(("height", "width"), [(320, 240), (321, 239), (130, 129), (128, 128)])
def test_padding_of_a_background_that_is_resampled_already_gives_the_same_frames(height, width):
    resampling = Resampling(height, width, 128, 128)
    rng = np.random.default_rng(0)
    background, image = rng.random((2, height, width, 3))
    found = resampling.covered(image) + resampling.padding(resampling.background(background))
    expected = resampling.frame(image, background)
    rows, columns = (weights.sum(axis=1) > 1 - 1e-9 for weights in resampling._overlaps())
    alone = rows.sum() in (127, 126) or columns.sum() in (127, 126)  # no pixel beyond those covered in part
    np.testing.assert_allclose(found, expected, atol=0.02 if alone else 1e-9)
