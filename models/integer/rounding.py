"""Rounding of a neuron's weights to integers whose errors cancel over the inputs that it sees.

Inputs of a layer are correlated, so that the rounding error of one weight can be made up for by the roundings
of others: the integers are sought whose errors add up to the least change of the neuron's sum, not those next
to each weight.
Source: Frantar, Ashkboos, Hoefler, Alistarh, "GPTQ", arXiv:2210.17323; the same as Babai's nearest plane.
"""

import numpy as np

SCALES = 16
"""Units of a neuron's weights that are tried, from that which the largest weight needs."""
LARGEST_SCALE = 1 / 0.7
"""The largest of them, in terms of the first."""
DAMPING = 1e-9
"""Added to the inputs' variances, relative to their mean."""


def input_moments(inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of inputs (samples, n), positive definite."""
    mean = inputs.mean(axis=0)
    apart = inputs - mean
    moments = apart.T @ apart / len(inputs)
    return mean, moments + (DAMPING * np.trace(moments) / len(mean) + 1e-12) * np.eye(len(mean))


def refitted(inputs: np.ndarray, sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (neurons, n) and biases (neurons,) of least squares from inputs (samples, n) to sums (samples,
    neurons)."""
    mean, moments = input_moments(inputs)
    centre = sums.mean(axis=0)
    weight = np.linalg.solve(moments, (inputs - mean).T @ (sums - centre) / len(inputs)).T
    return weight, centre - weight @ mean


def nearest_plane(weight: np.ndarray, moments: np.ndarray, top: int) -> tuple[np.ndarray, float]:
    """Integers (n,) of at most `top` for weights (n,) in their units, and the mean square error of the sum.

    moments : (n, n), the inputs' covariance. The weight of the widest input is rounded first, and what each
    rounding is off by goes into those that follow.
    """
    order = np.argsort(np.diag(moments), kind="stable")
    root = np.linalg.cholesky(moments[np.ix_(order, order)]).T
    left, found = root @ weight[order], np.zeros(len(weight), np.int64)
    for k in range(len(weight) - 1, -1, -1):
        found[order[k]] = integer = int(np.clip(np.rint(left[k] / root[k, k]), -top, top))
        left = left - root[:, k] * integer
    return found, float(left @ left)


def neuron(
    inputs: np.ndarray, sums: np.ndarray, *, top: int, limit: int, least: float
) -> tuple[np.ndarray, float, float]:
    """A neuron's integer weights (n,), the value of their unit, and its float bias.

    inputs : (samples, n), integers as the neuron sees them; sums : (samples,), what it should make of them
    top : largest magnitude of a weight; limit : largest sum of the inputs' magnitudes, of which a bias may
        have `top` times as many units; least : smallest unit
    """
    mean, moments = input_moments(inputs)
    (weight,), (bias,) = refitted(inputs, sums[:, None])
    needed = max(np.abs(weight).max() / top, abs(bias) / (limit * top), least)
    tried = []
    for unit in needed * np.geomspace(1, LARGEST_SCALE, SCALES):
        integers, error = nearest_plane(weight / unit, moments, top)
        tried.append((error * unit**2, unit, integers))
    _, unit, integers = min(tried, key=lambda one: one[:2])
    return integers, float(unit), float(sums.mean() - unit * (mean @ integers))
