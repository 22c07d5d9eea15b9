"""The integer reference: each stage's arithmetic, defined once.

Training, emulator, benches and hardware share these classes. Each is a frozen set of tables and widths
that checks itself and is called on int64 arrays; hardware equals it bit for bit.
Equations: Lu et al., "FasTac", section "FPGA-Based Edge Deployment".
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastac.models.integer.laplacian import divergence_of
from fastac.models.integer.words import (
    NEAREST,
    check_rounding,
    exact_matmul,
    half_unit,
    round_shift,
    signed_width,
)


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
        if self.divergence not in ("central", "backward"):
            raise ValueError(f"divergence {self.divergence!r}: expected central or backward")

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


@dataclass(frozen=True, eq=False)
class SineTransform:
    """One orthonormal DST-I pass along rows: `round_shift(matrix @ x, shift, rounding)`.

    matrix[k, n] = round(2**coefficient_fraction · sqrt(2/(N+1)) · sin(π(k+1)(n+1)/(N+1))).
    `bound` is the largest magnitude of the output that any input of the whole chain can reach.
    """

    matrix: np.ndarray  # (N, N)
    shift: int
    input_width: int
    output_width: int
    rounding: str = NEAREST

    def __post_init__(self):
        n = len(self.matrix)
        if self.matrix.shape != (n, n) or not np.array_equal(self.matrix, self.matrix.T):
            raise ValueError(f"matrix {self.matrix.shape}: expected square and symmetric")
        if self.shift < 1:
            raise ValueError(f"shift {self.shift}: expected at least 1")
        check_rounding(self.rounding)

    @property
    def size(self) -> int:
        return len(self.matrix)

    @property
    def half_unit(self) -> int:
        """What rounding adds to a sum before the shift; 0 with a floor."""
        return int(half_unit(self.shift, self.rounding))

    @property
    def coefficient_width(self) -> int:
        return signed_width(int(np.abs(self.matrix).max()))

    @cached_property
    def accumulator_bound(self) -> int:
        """max over rows of Σ|coefficient|·|x|max, plus the half unit that rounding adds."""
        return (int(np.abs(self.matrix).sum(axis=1).max()) << (self.input_width - 1)) + self.half_unit

    @property
    def accumulator_width(self) -> int:
        return signed_width(self.accumulator_bound)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Rows (..., N) to their transforms (..., N)."""
        sums = exact_matmul(rows, self.matrix, self.accumulator_bound)
        return round_shift(sums, self.shift, self.rounding)


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
