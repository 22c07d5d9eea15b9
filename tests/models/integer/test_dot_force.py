"""The dots' share of the force: words that fit their exponent, the sum's bound, and lost dots."""

import dots
import numpy as np
import pytest

from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.dot_force import DotForce
from fastac.models.integer.force import WeightedSum

SIDE, BITS = 32, 8
TOP = (1 << (BITS - 1)) - 1


@pytest.fixture(scope="module")
def follower():
    """Of 3 × 3 dots."""
    return dots.follower(SIDE + 4, SIDE + 4)


def of_words(words, follower, unit=0.25) -> DotForce:
    """The force of weights (axes, M, 2) in the skin's units per unit of shift."""
    units = np.full(len(words), unit)
    return DotForce.of_weights(np.asarray(words, float) * unit * 2**FRACTION, units, follower, BITS)


def random_force(follower, axes=3) -> DotForce:
    rng = np.random.default_rng(1)
    sizes = 10.0 ** np.arange(axes)[:, None, None]
    return of_words(rng.normal(scale=100, size=(axes, len(follower.rest), 2)) * sizes, follower)


@pytest.mark.parametrize(
    ("largest", "exponent"),
    [(0.0, 0), (0.3, 0), (TOP, 0), (TOP + 0.01, 1), (2 * TOP, 1), (2 * TOP + 0.01, 2), (1024 * TOP, 10)],
)
def test_the_exponent_is_the_smallest_with_which_the_words_fit(follower, largest, exponent):
    words = np.zeros((2, len(follower.rest), 2))
    words[0, 3, 1], words[1] = -largest, 1  # the other axis has its own
    found = of_words(words, follower)
    assert found.exponent.tolist() == [exponent, 0]
    assert found.weighted.weight[0, 3, 0, 1] == -round(largest / 2**exponent)
    assert np.abs(found.weighted.weight).max() <= TOP
    assert (found.weighted.weight[1] == 1).all()


def test_weights_are_to_the_nearest_and_in_the_skin_s_unit(follower):
    rng = np.random.default_rng(2)
    weights, units = rng.normal(size=(3, len(follower.rest), 2)), np.array([1e-3, 4e-7, 6e-9])
    found = DotForce.of_weights(weights, units, follower, 16)
    word_n = 2.0**found.exponent * units * 2**FRACTION
    stood_for = found.weighted.weight[:, :, 0] * word_n[:, None, None]
    error = np.abs(stood_for - weights).max(axis=(1, 2))
    assert (error <= word_n / 2 * (1 + 1e-9)).all()
    assert (error > word_n / 8).all()
    assert (found.exponent[1:] > 0).all()
    shift = rng.integers(-200, 201, (len(follower.rest), 2))
    force_n = found(shift) * units
    exact = (stood_for * shift / 2**FRACTION).sum(axis=(1, 2))
    np.testing.assert_allclose(force_n, exact, rtol=1e-12)


def test_equals_the_sum_by_the_definition(follower):
    found = random_force(follower)
    shifts = np.random.default_rng(3).integers(-follower.bound, follower.bound + 1, (2, 4, 9, 2))
    expected = np.empty((2, 4, 3), object)
    for *frame, axis in np.ndindex(expected.shape):
        products = found.weighted.weight[axis, :, 0] * shifts[tuple(frame)]
        expected[(*frame, axis)] = sum(products.ravel().tolist()) * 2 ** int(found.exponent[axis])
    np.testing.assert_array_equal(found(shifts), expected.astype(np.int64))
    np.testing.assert_array_equal(found(shifts[0, 1]), expected[0, 1].astype(np.int64))


def test_the_worst_signs_reach_the_bound(follower):
    found = random_force(follower)
    limit = found.weighted.input_limit
    assert limit >= follower.bound
    worst = limit * np.sign(found.weighted.weight[:, :, 0])  # one frame for each axis
    reached = np.abs(np.diag(found(worst)))
    assert reached.max() == found.bound
    assert reached.max() == reached[-1], "the axis with the largest weights"
    np.testing.assert_array_equal(found(-worst), -found(worst))


def test_a_lost_dot_adds_nothing(follower):
    rest, lost = follower.rest / (1 << FRACTION), 4
    places = np.delete(rest + np.array((1.5, -1.0)), lost, axis=0)
    shift, seen = follower(follower.windows(dots.frame(SIDE + 4, SIDE + 4, places)))
    assert np.flatnonzero(~seen).tolist() == [lost]
    found = random_force(follower)
    without = found.weighted.weight.copy()
    without[:, lost] = 0
    weighted = WeightedSum(without, found.weighted.constant, found.weighted.input_width, True)
    np.testing.assert_array_equal(found(shift), DotForce(weighted, found.exponent)(shift))
    assert found(shift).all()
    assert not found(0 * shift).any()


@pytest.mark.parametrize(
    ("constant", "exponent", "message"),
    [
        ([0, 0], [0], r"exponent \[0\]: expected one of 0 or more for each axis"),
        ([0, 0], [0, -1], r"exponent \[ 0 -1\]: expected one of 0 or more"),
        ([0, 3], [0, 0], "constant: expected 0, for dots at rest have no shift"),
    ],
)
def test_refused(constant, exponent, message):
    weighted = WeightedSum(np.ones((2, 3, 1, 2), int), np.array(constant), 8, True)
    with pytest.raises(ValueError, match=message):
        DotForce(weighted, np.array(exponent))
