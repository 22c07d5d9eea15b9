"""The right-hand side of the Poisson problem in integers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.laplacian import STENCILS, divergence_of
from fastac.models.integer.words import signed_width


@dataclass(frozen=True, eq=False)
class PoissonSource:
    """The right-hand side on the inner region: divergence of the slopes less `offset`.

    `central`: p[i,j+1] − p[i,j−1] + q[i+1,j] − q[i−1,j], one fractional bit more than the slopes.
    `backward`: p[i,j] − p[i,j−1] + q[i,j] − q[i−1,j], the paper's.
    `offset` is the boundary prior's term Σ D_prior of the neighbours on the boundary (absolute depth), or
    the source of the background's slopes (difference from the background).
    """

    divergence: str
    gradient_width: int
    offset: np.ndarray  # (H − 2, W − 2)
    offset_limit: int | None = None
    """The largest magnitude of any offset that the hardware may be loaded with; None: only this one."""

    def __post_init__(self):
        largest = int(np.abs(self.offset).max())
        if self.offset_limit is not None and largest > self.offset_limit:
            raise ValueError(f"offset {largest}: expected at most {self.offset_limit}")
        if self.divergence not in STENCILS:
            raise ValueError(f"divergence {self.divergence!r}: expected {' or '.join(STENCILS)}")

    @property
    def terms(self) -> int:
        """How many slopes enter one value, each with weight ±1."""
        return 4

    @cached_property
    def bound(self) -> int:
        offset = int(np.abs(self.offset).max()) if self.offset_limit is None else self.offset_limit
        return self.terms * ((1 << (self.gradient_width - 1)) - 1) + offset

    @property
    def width(self) -> int:
        return signed_width(self.bound)

    def __call__(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (..., H, W, 2) to the source (..., H − 2, W − 2)."""
        return divergence_of(slopes, self.divergence) - self.offset
