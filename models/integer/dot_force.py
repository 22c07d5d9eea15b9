"""The dots' share of the force in integers: a weighted sum of their shifts, in the skin's force units."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.integer.force import WeightedSum


@dataclass(frozen=True, eq=False)
class DotForce:
    """A = 2**exponent · Σ_d (weight_u · shift_u + weight_v · shift_v) per axis, over the M dots of a frame.

    It is added to the sum over the skin, displacements or slopes. A lost dot has no shift, so it adds
    nothing.
    """

    weighted: WeightedSum  # of M rows of one dot with two terms, (axes, M, 1, 2)
    exponent: np.ndarray  # (axes,): the skin's unit of force is 2**exponent times finer

    def __post_init__(self):
        if self.exponent.shape != self.weighted.constant.shape or self.exponent.min() < 0:
            raise ValueError(f"exponent {self.exponent}: expected one of 0 or more for each axis")
        if self.weighted.constant.any():
            raise ValueError("constant: expected 0, for dots at rest have no shift")

    @classmethod
    def of_weights(
        cls, weights_n_per_px: np.ndarray, force_n_per_unit: np.ndarray, follower: DotFollower, bits: int
    ) -> "DotForce":
        """From weights (axes, M, 2) in N per px, as integers of `bits`, and the skin's unit (axes,) in N.

        The exponent is the smallest with which the largest weight of an axis fits.
        """
        units = weights_n_per_px / (2**FRACTION * force_n_per_unit[:, None, None])
        largest = np.abs(units).max(axis=(1, 2))
        top = (1 << (bits - 1)) - 1
        exponent = np.maximum(np.ceil(np.log2(np.maximum(largest, 1) / top)), 0).astype(np.int64)
        words = np.rint(units / 2.0 ** exponent[:, None, None]).astype(np.int64)
        words = np.clip(words, -top, top)
        constant = np.zeros(len(words), np.int64)
        return cls(WeightedSum(words[:, :, None], constant, follower.width, input_signed=True), exponent)

    @cached_property
    def bound(self) -> int:
        """The largest magnitude that any shifts give, the worst axis."""
        weight = np.abs(self.weighted.weight).sum(axis=(1, 2, 3))
        return max(
            int(total) * self.weighted.input_limit << int(exponent)
            for total, exponent in zip(weight, self.exponent, strict=True)
        )

    def __call__(self, shifts: np.ndarray) -> np.ndarray:
        """Shifts (..., M, 2) to what they add to the raw accumulators, (..., axes)."""
        return self.weighted(shifts[..., None, :]) << self.exponent
