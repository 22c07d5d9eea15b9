"""Points and wrench for LeRobot: sums and means over a grid of taxels, and NaN for what is not found."""

from dataclasses import replace

import numpy as np
import pytest
from records_by_hand import ABOUT, a_record, sent

from fastac.streaming import about as abouts
from fastac.streaming import record as records

REST_MM = np.full((4, 6), 2.0)


@pytest.fixture
def received(messages):
    return lambda **changes: messages.decode(sent(records.encode(a_record(**changes))))


@pytest.fixture
def taxels(part, messages):
    """`taxels((rows, columns), …)`: a grid over a stream's skin, described with changes."""
    describe = lambda changes: messages.decode(sent(abouts.encode(replace(ABOUT, **changes))))  # noqa: E731
    return lambda grid, **changes: part("taxels").Taxels(describe(changes), grid)


def test_points_are_means_of_the_indentation_and_sums_of_the_force(taxels, received):
    record = received()
    points = taxels((2, 3)).points(record, REST_MM)
    assert points.shape == (6, 6)
    assert points.dtype == np.float32
    pressed = 2.0 - record.arrays["depth_mm"].astype(float)
    np.testing.assert_allclose(points[0, 2], pressed[:2, :2].mean(), rtol=1e-6)
    np.testing.assert_allclose(points[5, 2], pressed[2:, 4:].mean(), rtol=1e-6)
    np.testing.assert_allclose(points[1, 3:], record.arrays["force_map_n"][:, :2, 2:4].sum((1, 2)), rtol=1e-6)
    assert np.isnan(points[:, :2]).all()


def test_no_pixel_is_left_out_where_taxels_cannot_be_equal(taxels, received):
    record = received()
    points = taxels((3, 4)).points(record, None)
    np.testing.assert_allclose(
        points[:, 3:].sum(0), record.arrays["force_map_n"].sum((1, 2)), rtol=1e-5, atol=1e-6
    )
    np.testing.assert_allclose(
        taxels((4, 6)).points(record, REST_MM)[:, 2],
        2.0 - record.arrays["depth_mm"].ravel(),
        rtol=1e-6,
    )


def test_what_the_stream_does_not_find_is_nan(taxels, received, part):
    depth = a_record().arrays["depth_mm"]
    one_axis = {"depth_mm": depth, "force_map_n": np.ones((1, 4, 6), np.float32)}
    points = taxels((2, 3), force_axes=("z",)).points(received(arrays=one_axis), None)
    assert np.isnan(points[:, :5]).all()
    np.testing.assert_array_equal(points[:, 5], 4)
    nothing = received(arrays={}, force_n={})
    assert np.isnan(taxels((2, 3)).points(nothing, REST_MM)).all()
    assert np.isnan(part("taxels").wrench(nothing)).all()


def test_a_wrench_has_the_force_in_order_and_no_torques(part, received):
    found = part("taxels").wrench(received(force_n={"z": 1.5, "x": 0.25}))
    np.testing.assert_array_equal(found, np.float32([0.25, np.nan, 1.5, np.nan, np.nan, np.nan]))


def test_taxels_are_centred_on_the_image(taxels):
    grid = taxels((2, 3))
    np.testing.assert_allclose(grid.positions_mm[0], [-0.5, -0.25])
    np.testing.assert_allclose(grid.positions_mm[1], [0, -0.25])
    np.testing.assert_allclose(grid.positions_mm[5], [0.5, 0.25])


@pytest.mark.parametrize("grid", [(5, 6), (4, 7), (0, 3)])
def test_a_grid_finer_than_the_pixels_is_refused(taxels, grid):
    with pytest.raises(ValueError, match=r"grid = .*: the sensor has 4 × 6 px without its rim"):
        taxels(grid)
