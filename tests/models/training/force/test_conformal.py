"""Coverage of new groups is what was asked for, by counting; scales that are not negative."""

import itertools

import numpy as np
import pytest

from fastac.models.training.force.conformal import (
    group_weights,
    linear_scale,
    pooled_quantile,
    supported,
    wilson,
)


@pytest.mark.parametrize(("count", "coverage"), [(4, 0.8), (9, 0.9), (9, 0.55), (20, 0.9), (19, 0.95)])
def test_coverage_of_exchangeable_groups_is_exact(count, coverage):
    """Of count + 1 different scores each is as likely the new one's: leaving out each in turn counts all."""
    scores, groups = np.random.default_rng(1).normal(size=count + 1), np.arange(count)
    inside = [scores[k] <= pooled_quantile(np.delete(scores, k), groups, coverage) for k in range(count + 1)]
    assert np.sum(inside) == np.ceil(round(coverage * (count + 1), 9))


def test_coverage_of_groups_whose_frames_are_alike():
    """Frames of one group have the same score and their numbers differ: the frames' quantile would fail."""
    rng, coverage, inside = np.random.default_rng(2), 0.8, []
    for _ in range(4000):
        of_group = rng.normal(size=10)
        count = np.where(of_group[:9] < 0, 50, 1)  # good groups have more frames
        groups = np.repeat(np.arange(9), count)
        inside.append(of_group[9] <= pooled_quantile(of_group[:9][groups], groups, coverage))
    assert np.mean(inside) == pytest.approx(coverage, abs=3 * np.sqrt(0.16 / 4000))


def test_frames_within_groups_count_by_their_share():
    groups = np.array([0, 0, 0, 0, 7, 7])
    assert group_weights(groups).tolist() == [0.125] * 4 + [0.25] * 2
    scores = np.array([1.0, 2, 3, 4, 2.5, 9])
    # Shares of 3 groups, one of them infinite: 1/12 each for the first, 1/6 each for the second.
    steps = {1.0: 1 / 12, 2.0: 2 / 12, 2.5: 4 / 12, 3.0: 5 / 12, 4.0: 6 / 12, 9.0: 8 / 12}
    for q, reached in steps.items():
        assert pooled_quantile(scores, groups, reached) == q
        assert pooled_quantile(scores, groups, reached - 1e-6) == q


@pytest.mark.parametrize("count", [1, 2, 8, 40])
def test_too_few_groups_are_refused(count):
    scores, most = np.arange(count, dtype=float), supported(count)
    assert pooled_quantile(scores, np.arange(count), most) == count - 1
    with pytest.raises(ValueError, match=rf"coverage .*: {count} groups support at most 0\.\d+"):
        pooled_quantile(scores, np.arange(count), most + 1e-6)


def test_the_order_of_frames_does_not_matter():
    rng = np.random.default_rng(3)
    scores, groups = rng.integers(0, 9, 12).astype(float), rng.integers(0, 5, 12)
    orders = itertools.islice(itertools.permutations(range(12)), 0, 10**7, 999_983)
    found = {pooled_quantile(scores[list(o)], groups[list(o)], 0.6) for o in orders}
    assert len(found) == 1


def test_the_scale_is_found_and_never_negative():
    rng = np.random.default_rng(4)
    magnitudes = rng.integers(0, 1000, (4000, 3)).astype(float)
    scale = 0.3 + magnitudes @ [0.002, 0.0, 0.0005]
    base, weights = linear_scale(magnitudes, np.abs(rng.normal(scale=scale)) / np.sqrt(2 / np.pi))
    assert base == pytest.approx(0.3, rel=0.15)
    assert weights == pytest.approx([0.002, 0, 0.0005], abs=1e-4)
    # An error that falls with a measure: it gets no weight.
    base, weights = linear_scale(magnitudes, 1000 - magnitudes[:, 0])
    assert weights[0] == 0
    assert base > 0


def test_scales_of_little():
    base, weights = linear_scale(np.zeros((5, 2)), np.zeros(5))
    assert base > 0
    assert not weights.any()
    base, weights = linear_scale(np.zeros((5, 0)), np.full(5, 2.0))
    assert base == pytest.approx(2)
    assert weights.shape == (0,)


def test_wilson_s_interval():
    assert wilson(0.9, 100) == pytest.approx((0.8256, 0.9448), abs=1e-4)
    low, high = wilson(1.0, 20)
    assert high == pytest.approx(1)
    assert low == pytest.approx(0.8389, abs=1e-4)
