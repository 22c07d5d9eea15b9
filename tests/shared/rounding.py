"""Operands whose products are about to round to another value: what a test of low product bits needs."""

import numpy as np


def to_the_edge(product, shift, half=0) -> np.ndarray:
    """How many units `product` + `half` is away from another value of (product + half) >> shift."""
    unit = np.int64(1) << np.asarray(shift, np.int64)
    below = (np.asarray(product, np.int64) + half) % unit
    return np.minimum(below, unit - 1 - below)


def at_the_edges(operands: np.ndarray, factor: int, shift: int, half: int, count: int) -> np.ndarray:
    """The `count` of `operands` whose products with `factor` are nearest to rounding differently."""
    distance = to_the_edge(operands * factor, shift, half)
    return operands[np.argpartition(distance, count - 1)[:count]]
