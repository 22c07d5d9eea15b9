from itertools import product

import numpy as np

from fastac.models.integer import rounding


def test_refitted_weights_come_back():
    rng = np.random.default_rng(1)
    inputs, weight, bias = rng.normal(size=(200, 3)), rng.normal(size=(2, 3)), rng.normal(size=2)
    found, of_bias = rounding.refitted(inputs, inputs @ weight.T + bias)
    np.testing.assert_allclose(found, weight, atol=1e-7)
    np.testing.assert_allclose(of_bias, bias, atol=1e-7)


def test_roundings_make_up_for_each_other():
    """Of two inputs that are nearly the same, only the sum of the weights counts."""
    moments = np.array([[1.0, 0.999], [0.999, 1.0]])
    found, error = rounding.nearest_plane(np.array([1.4, 2.4]), moments, 127)
    assert found.sum() == 4  # the nearest integers are 1 and 2
    off = np.array([1.4, 2.4]) - found
    assert np.isclose(error, off @ moments @ off)
    around = [np.array(q) - [1.4, 2.4] for q in product(range(-1, 5), repeat=2)]
    assert np.isclose(error, min(off @ moments @ off for off in around))


def test_words_are_kept():
    found, _ = rounding.nearest_plane(np.array([300.0, -300.0]), np.eye(2), 127)
    assert found.tolist() == [127, -127]
