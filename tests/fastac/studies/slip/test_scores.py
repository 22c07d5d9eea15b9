"""Areas, correlations and limits on values that are made up."""

import numpy as np
import pytest

from fastac.studies.slip import scores

SLIPS = np.array([False, False, False, True, True])


def test_the_area_is_the_share_of_pairs_in_order():
    assert scores.area_under_curve(np.array([1.0, 2, 3, 4, 5]), SLIPS) == 1
    assert scores.area_under_curve(np.array([5.0, 4, 3, 2, 1]), SLIPS) == 0
    # Of the six pairs four are in order and one is equal.
    assert scores.area_under_curve(np.array([1.0, 2, 4, 2, 5]), SLIPS) == pytest.approx(4.5 / 6)
    assert scores.area_under_curve(np.ones(5), SLIPS) == 0.5


@pytest.mark.parametrize("slips", [np.zeros(5, bool), np.ones(5, bool)])
def test_one_kind_alone_cannot_be_told_apart(slips):
    assert scores.area_under_curve(np.arange(5.0), slips) is None
    assert scores.best_limit(np.arange(5.0), slips) is None


def test_ranks_are_compared_within_drags():
    rising, falling = np.arange(6.0), np.arange(6.0)[::-1]
    assert scores.rank_correlation([(rising, rising**2), (rising + 100, rising)]) == pytest.approx(1)
    assert scores.rank_correlation([(rising, rising), (rising, falling)]) == pytest.approx(0)


def test_drags_without_ranks_do_not_count():
    level, rising = np.ones(6), np.arange(6.0)
    short = np.arange(scores.LEAST_STEPS - 1.0)
    assert scores.rank_correlation([(level, rising), (rising, level), (short, short)]) is None
    assert scores.rank_correlation([(level, rising), (rising, rising)]) == pytest.approx(1)


def test_means_are_interpolated_and_not_extrapolated():
    inside = np.array([1.0, 3.0, 2.0]), np.array([0.0, 1.0, 0.5])
    beside = np.array([7.0, 9.0]), np.array([0.6, 0.9])
    empty = np.empty(0), np.empty(0)
    assert scores.mean_at(0.25, [inside, beside, empty]) == pytest.approx(1.5)
    assert scores.mean_at(0.75, [inside, beside]) == pytest.approx((2.5 + 8) / 2)
    assert scores.mean_at(0.25, [beside, empty]) is None


def test_rates():
    flagged = np.array([True, False, False, True, True])
    assert scores.rates(flagged, SLIPS) == {"hit": 1, "false_alarm": pytest.approx(1 / 3)}
    assert scores.rates(flagged, np.ones(5, bool)) == {"hit": pytest.approx(3 / 5), "false_alarm": None}


def test_the_best_limit_has_the_largest_balanced_accuracy():
    values = np.array([0.1, 0.2, 0.6, 0.4, 0.8])
    assert scores.best_limit(values, SLIPS) == pytest.approx(0.3)  # two hits, one false alarm of three
    assert scores.best_limit(np.ones(5), SLIPS) is None
    clear = np.array([1.0, 2.0, 3.0, 5.0, 9.0])
    assert scores.best_limit(clear, SLIPS) == 4
