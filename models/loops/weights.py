"""Compiled weighted sums over pixels of one frame: each task's share of the force.

In float64; of integers whose sums float64 holds, exact in whatever order.
"""

import numpy as np

from fastac.store.compiled_loops import compiled


@compiled(fastmath={"reassoc", "nsz"})
def weigh(values, weight):
    """The sum of values (pixels,) times weights (pixels or more,)."""
    total = 0.0
    for j in range(len(values)):
        total += np.float64(values[j]) * weight[j]
    return total


@compiled()
def weigh_terms(values, bends, weight, first, share):
    """Write the sums of the `integer.force.terms` of values (pixels,) times weights (axes, terms, all
    pixels), from pixel `first` on, into `share` (axes,).

    bends : none, (band,) or (band, deep, deeper, …), in the values' unit and type
    """
    zero, beyond = values.dtype.type(0), np.empty_like(values)
    for axis in range(len(weight)):
        share[axis] = weigh(values, weight[axis, 0, first:])
    for term in range(1, weight.shape[1]):
        bend = bends[max(term - 2, 0)]  # terms 1 and 2 are both of the band
        for j in range(len(values)):
            beyond[j] = min(values[j] + bend, zero) if term == 2 else max(values[j] - bend, zero)
        for axis in range(len(weight)):
            share[axis] += weigh(beyond, weight[axis, term, first:])
