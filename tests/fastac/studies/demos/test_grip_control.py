"""The feedback's logic, on forces and flags that are made up."""

import numpy as np
import pytest

from fastac.studies.demos.grip_control import (
    FrictionFeedback,
    GripControl,
    SlipFeedback,
    friction_ratio,
    without_feedback,
)


def force(ratio, normal=1.0):
    return np.array([0.6 * ratio * normal, -0.8 * ratio * normal, normal])


def test_the_ratio_is_shear_over_normal():
    assert friction_ratio(force(0.5, 2.0)) == pytest.approx(0.5)
    np.testing.assert_array_equal(friction_ratio(np.array([[0.1, 0, 0], [0.1, 0, -1]])), [np.inf, np.inf])


@pytest.mark.parametrize("slip_px", [None, 0.5])
def test_it_tightens_above_the_limit_only_and_not_for_ever(slip_px):
    control = GripControl(FrictionFeedback(0.5, 0.1), step_deg=0.25, most_deg=0.6)
    assert [control(force(ratio), slip_px) for ratio in (0.1, 0.59, 0.61, 0.3, 0.7, 0.8, 0.9)] == [
        *(0, 0, 0.25, 0.25, 0.5, 0.6, 0.6)
    ]


def test_what_it_does_shows_after_its_delay():
    control = GripControl(FrictionFeedback(0.5, 0.0), step_deg=1.0, most_deg=9.0, delay_frames=3)
    found = [control(force(ratio), None) for ratio in (0.9, 0.1, 0.9, 0.1, 0.1, 0.1)]
    assert found == [0, 0, 1, 1, 2, 2]
    assert control.tightened_deg == 2


@pytest.mark.parametrize("ratio", [0.0, 5.0])
def test_a_spread_that_rises_tightens_whatever_the_force(ratio):
    control = GripControl(SlipFeedback(), step_deg=0.25, most_deg=0.6)
    spreads_px = (None, 0.4, 0.4, None, 0.3, 0.5, 0.6, 0.7)
    found = [control(force(ratio), slip_px) for slip_px in spreads_px]
    assert found == [0, 0.25, 0.25, 0.25, 0.25, 0.5, 0.6, 0.6]


def test_without_feedback_nothing_moves():
    control = GripControl(without_feedback, step_deg=1.0, most_deg=9.0)
    assert control(force(5.0), 0.5) == control(np.array([1.0, 0.0, -1.0]), None) == 0
