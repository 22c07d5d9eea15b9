"""How wide the interval around each force is, in integers: a sum of a few measures of the frame.

The widths follow from presses that the models have not learned from (`training/force/conformal.py`): wider
where the load is large, where the light has drifted and where much of the skin has changed.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.words import _fits

LOAD = "load"
"""The measure that is the raw force itself, of one axis."""
OF_PIXELS = REASONS[: REASONS.index("gradient") + 1]
"""Measures of `FrameValidity` that are complete with the frame's last slope, before any force is."""
INTERVAL = "force_interval"
"""In a bundle's provenance: what its intervals hold and follow from; "asked", the scene's coverage,
"coverage", what they are made for, "groups" and "frames" that they are calibrated on, "trainings" that these
groups were left out of, one each."""
WEIGHT_BITS = 17
"""Bits of a weight, without a sign: with one it fits a DSP's port of 18."""
MEASURE_BITS = 24
"""Bits of a measure's magnitude after its shift."""
BASE_BITS = WEIGHT_BITS + MEASURE_BITS


def shifts_of(limits: np.ndarray) -> np.ndarray:
    """How far measures with these largest magnitudes must be shifted to fit MEASURE_BITS, (K,)."""
    top = (1 << MEASURE_BITS) - 1
    return np.array([next(s for s in range(64) if -(-int(limit) >> s) <= top) for limit in limits], np.int64)


@dataclass(frozen=True, eq=False)
class ForceInterval:
    """Half the width of the interval around each force of A axes, in units of that axis's raw accumulator:

        half[a] = ⌊2**exponent[a] · (base[a] + Σ_k weights[a, k] · |m_k >> shifts[k]|)⌋

    m_k : the K measures of `measures`; LOAD, the last one if it is there, is the raw accumulator of axis
        `load_axis`. >> is arithmetic: it rounds negative measures away from zero.
    limits : (K,) the largest magnitude of each measure before its shift

    Nothing can overflow or saturate: every width follows from `limits`.
    """

    measures: tuple[str, ...]
    limits: np.ndarray  # (K,)
    shifts: np.ndarray  # (K,)
    weights: np.ndarray  # (A, K), 0 or more
    base: np.ndarray  # (A,), 0 or more
    exponent: np.ndarray  # (A,), negative where bits are dropped
    load_axis: int = 0

    def __post_init__(self):
        count, axes = len(self.measures), len(self.base)
        for name, expected in (
            ("limits", (count,)),
            ("shifts", (count,)),
            ("weights", (axes, count)),
            ("base", (axes,)),
            ("exponent", (axes,)),
        ):
            if np.shape(getattr(self, name)) != expected:
                raise ValueError(f"{name} {np.shape(getattr(self, name))}: expected {expected}")
        for place, name in enumerate(self.measures):
            if name not in (*OF_PIXELS, LOAD) or name in self.measures[:place]:
                raise ValueError(f"measures {self.measures}: {name!r} is unknown or there twice")
        if LOAD in self.measures[:-1]:
            raise ValueError(f"measures {self.measures}: expected {LOAD!r} behind all others")
        if not 0 <= self.load_axis < axes:
            raise ValueError(f"load_axis {self.load_axis}: expected 0 to {axes - 1}")
        _fits("weights", self.weights, WEIGHT_BITS, signed=False)
        _fits("base", self.base, BASE_BITS, signed=False)
        _fits("limits", self.limits, 62, signed=False)
        _fits("shifts", self.shifts, 6, signed=False)
        _fits("magnitude", self.magnitude_bounds, MEASURE_BITS, signed=False)
        if max(self.half_bounds) >= 1 << 62:
            raise ValueError(f"exponent {self.exponent}: half widths of up to {max(self.half_bounds)}")

    @classmethod
    def of_weights(
        cls,
        measures: tuple[str, ...],
        limits: np.ndarray,
        weights: np.ndarray,
        base: np.ndarray,
        load_axis: int = 0,
    ) -> "ForceInterval":
        """From real numbers in units of the raw accumulators.

        weights : (A, K) of the measures' magnitudes after `shifts_of(limits)`; base : (A,)


        Words are rounded upwards, so that no interval is narrower than the numbers say. The exponent of each
        axis is the smallest with which its words fit.
        """
        top, most = (1 << WEIGHT_BITS) - 1, (1 << BASE_BITS) - (2 << MEASURE_BITS)
        needed = np.maximum(weights.max(axis=1, initial=0) / top, base / most)
        # Without weights, bits behind the point of a raw force's unit would say nothing.
        least = np.where(weights.any(axis=1), 2.0**-MEASURE_BITS, 1.0)
        exponent = np.ceil(np.log2(np.maximum(needed * (1 + 1e-9), least))).astype(np.int64)
        unit = 2.0**exponent
        # What the floor drops is less than one raw unit.
        dropped = np.int64(1) << np.maximum(-exponent, 0)
        words = np.ceil(base / unit).astype(np.int64) + np.where(exponent < 0, dropped - 1, 0)
        return cls(
            measures,
            np.asarray(limits, np.int64),
            shifts_of(limits),
            np.ceil(weights / unit[:, None]).astype(np.int64),
            words,
            exponent,
            load_axis,
        )

    @property
    def pixel_measures(self) -> tuple[str, ...]:
        """The measures that come from the pixels: all but the load."""
        return tuple(name for name in self.measures if name != LOAD)

    @property
    def uses_load(self) -> bool:
        return LOAD in self.measures

    @cached_property
    def magnitude_bounds(self) -> tuple[int, ...]:
        """The largest |m_k >> shifts[k]|, that of a negative measure: (K,)."""
        return tuple(
            -(-int(limit) >> int(shift)) for limit, shift in zip(self.limits, self.shifts, strict=True)
        )

    @property
    def magnitude_widths(self) -> tuple[int, ...]:
        """Bits of each measure's magnitude, without a sign."""
        return tuple(max(bound.bit_length(), 1) for bound in self.magnitude_bounds)

    @property
    def product_widths(self) -> tuple[int, ...]:
        """Bits of each measure's product with the largest of its weights, without a sign."""
        largest = self.weights.max(axis=0, initial=0)
        return tuple(
            max((int(weight) * bound).bit_length(), 1)
            for weight, bound in zip(largest, self.magnitude_bounds, strict=True)
        )

    @cached_property
    def sum_bounds(self) -> tuple[int, ...]:
        """The largest base[a] + Σ_k …, (A,)."""
        return tuple(
            int(base) + sum(int(w) * bound for w, bound in zip(row, self.magnitude_bounds, strict=True))
            for base, row in zip(self.base, self.weights, strict=True)
        )

    @property
    def sum_width(self) -> int:
        """Bits of every axis's sum, without a sign."""
        return max(max(self.sum_bounds).bit_length(), 1)

    @property
    def half_bounds(self) -> tuple[int, ...]:
        """The largest half-width of each axis, (A,)."""
        return tuple(
            bound << int(e) if e >= 0 else bound >> -int(e)
            for bound, e in zip(self.sum_bounds, self.exponent, strict=True)
        )

    @property
    def half_width(self) -> int:
        """Bits of every axis's half-width, without a sign."""
        return max(max(self.half_bounds).bit_length(), 1)

    def columns(self, names: tuple[str, ...]) -> list[int]:
        """Where `pixel_measures` are among a `FrameValidity`'s `names`."""
        return [names.index(name) for name in self.pixel_measures]

    def half_widths(self, measures: np.ndarray, forces_raw: np.ndarray) -> np.ndarray:
        """`pixel_measures` (frames, …) int64 and raw forces (frames, A) to half-widths (frames, A) int64."""
        found = np.asarray(measures, np.int64)
        if self.uses_load:
            found = np.concatenate([found, forces_raw[..., self.load_axis, None]], axis=-1)
        magnitudes = np.abs(found >> self.shifts)
        total = magnitudes @ self.weights.T + self.base
        return total << np.maximum(self.exponent, 0) >> np.maximum(-self.exponent, 0)
