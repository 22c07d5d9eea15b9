import numpy as np
import pytest

from fastac.models.floating.tangential_field import TangentialField, displacement_mm
from fastac.models.vision.markers import MarkerError, TrackedMarkers

GRID = np.stack(np.meshgrid(np.arange(4, 64, 8.0), np.arange(4, 48, 8.0)), axis=-1).reshape(-1, 2)


def field(**keys):
    return TangentialField(GRID, 48, 64, **keys)


def test_exact_at_the_markers_and_the_paper_s_kernel_between():
    shape = field(epsilon_px=6.0)
    d = np.random.default_rng(0).normal(size=(len(GRID), 2))
    dense = shape.dense_px(d)
    assert dense.shape == (48, 64, 2)
    at = GRID.astype(int)
    np.testing.assert_allclose(dense[at[:, 1], at[:, 0]], d, atol=1e-9)

    def kernel(p):
        return 1 / np.sqrt(((p[:, None] - GRID) ** 2).sum(axis=-1) + 36)

    weights = np.linalg.solve(kernel(GRID), d)
    np.testing.assert_allclose(dense[17, 30], (kernel(np.array([[30.0, 17.0]])) @ weights)[0], atol=1e-9)


def test_smooth_fields_are_recovered():
    v, u = np.indices((48, 64))

    def bump(x, y):
        return np.exp(-((x - 30) ** 2 + (y - 20) ** 2) / 2 / 12**2)

    d = bump(GRID[:, 0], GRID[:, 1])[:, None] * (3.0, -2.0)
    dense = field().dense_px(d)
    error = dense - bump(u, v)[..., None] * (3.0, -2.0)
    assert np.abs(error[4:-4, 4:-4]).max() < 0.05


def test_frames_at_once():
    shape = field()
    d = np.random.default_rng(0).normal(size=(5, len(GRID), 2))
    np.testing.assert_allclose(shape.dense_px(d)[3], shape.dense_px(d[3]), atol=1e-12)


def test_lost_markers_are_left_out_and_their_matrix_is_kept():
    d = np.random.default_rng(0).normal(size=(len(GRID), 2))
    lost = np.zeros(len(GRID), bool)
    shape = field()
    np.testing.assert_array_equal(shape.tracked_px(tracked(d, lost)), shape.dense_px(d))
    lost[[3, 20]] = True
    d[lost] = 1e6
    dense = shape.tracked_px(tracked(d, lost))
    remaining = TangentialField(GRID[~lost], 48, 64, shape.epsilon_px)
    np.testing.assert_array_equal(dense, remaining.dense_px(d[~lost]))
    shape.tracked_px(tracked(d, lost))
    assert shape._of_subset.cache_info().misses == 1


def tracked(displacement, lost):
    return TrackedMarkers(GRID + displacement, displacement, lost, np.empty((0, 2)))


def test_displacement_of_all_axes():
    tangential = np.full((4, 5, 2), (2.0, -4.0))
    rest, pressed = np.full((4, 5), 3.0), np.full((4, 5), 2.5)
    np.testing.assert_allclose(
        displacement_mm(tangential, rest, pressed, 0.125), np.broadcast_to([0.25, -0.5, 0.5], (4, 5, 3))
    )
    with pytest.raises(MarkerError, match="expected"):
        displacement_mm(tangential, rest[1:], pressed[1:], 0.125)


@pytest.mark.parametrize(
    ("markers", "message"),
    [
        (GRID[:2], "2 given: the displacement field needs at least 3"),
        (np.concatenate([GRID, GRID[5:6]]), "two are 0 px apart at u = 44.0, v = 4.0"),
        (np.where(np.arange(len(GRID))[:, None] == 4, np.nan, GRID), "not finite"),
    ],
)
def test_refuses_markers_that_give_no_field(markers, message):
    with pytest.raises(MarkerError, match=message):
        TangentialField(markers, 48, 64)


def test_refuses_too_few_that_are_left():
    lost = np.ones(len(GRID), bool)
    lost[:2] = False
    with pytest.raises(MarkerError, match=f"2 of {len(GRID)} left: the displacement field needs 3"):
        field().tracked_px(tracked(np.zeros_like(GRID), lost))
    with pytest.raises(MarkerError, match="marker displacements"):
        field().dense_px(np.zeros((4, 2)))
