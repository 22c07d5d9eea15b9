"""From the Poisson solver's solution to depth, displacement and quantised displacement, in integers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.words import round_shift, signed_width


@dataclass(frozen=True, eq=False)
class Depth:
    """What leaves the solver: the depth, and the displacement from rest.

    `absolute`: depth = z, displacement = rest − z, `rest` being what the pipeline finds at rest.
    `difference`: depth = rest + z, displacement = −z, `rest` being the known skin.
    """

    mode: str
    input_width: int
    rest: np.ndarray  # (N, N)
    loadable: bool = False
    """Whether the hardware may be loaded with another `rest`, any solution of the solver."""

    def __post_init__(self):
        if self.mode not in ("absolute", "difference"):
            raise ValueError(f"mode {self.mode!r}: expected absolute or difference")

    @cached_property
    def width(self) -> int:
        """Bits of depth and of displacement alike."""
        if self.loadable:
            return self.input_width + 1
        return signed_width((1 << (self.input_width - 1)) + int(np.abs(self.rest).max()))

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solutions (..., N, N) to depth and displacement of the same shape."""
        if self.mode == "absolute":
            return z, self.rest - z
        return self.rest + z, -z


@dataclass(frozen=True)
class DisplacementQuantiser:
    """`q = clip(round_shift(max(d, 0), shift), 0, 2**bits − 1)`, the paper's Q_z.

    Without the clamp q is signed: `clip(round_shift(d, shift), −t, t)`, t = 2**(bits − 1) − 1.
    """

    input_width: int
    shift: int
    bits: int
    clamp: bool = True

    @property
    def top(self) -> int:
        """The largest word."""
        return (1 << (self.bits if self.clamp else self.bits - 1)) - 1

    def __call__(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements of any shape to words, and which of them saturated."""
        scaled = round_shift(np.maximum(d, 0) if self.clamp else d, self.shift)
        return np.clip(scaled, -self.top, self.top), np.abs(scaled) > self.top
